"""``posecal program``: a plan as a robot program."""
