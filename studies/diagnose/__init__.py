"""``posecal diagnose``: its record, how it is told and drawn, its command."""

NEXT = 8
"""Poses that are proposed where rivals are left."""
