"""``posecal iso9283``: its record, how it is told, its command."""
