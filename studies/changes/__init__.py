"""``posecal changes``: its command, its record and how it is told."""
