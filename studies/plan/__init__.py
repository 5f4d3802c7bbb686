"""``posecal diagnose --plan-only``: its record, how it is told and drawn."""
