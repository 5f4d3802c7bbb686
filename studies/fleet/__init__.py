"""``posecal fleet``: every robot below a folder, its record, how it is told and drawn, its command."""
