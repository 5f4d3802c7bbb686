"""The day of a plan: the ways between its poses, their order, and how long it takes."""
