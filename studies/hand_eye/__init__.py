"""``posecal hand-eye``: its record, how it is told, its command."""
