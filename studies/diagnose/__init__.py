"""``posecal diagnose``: its record, how it is told and drawn, its command."""
