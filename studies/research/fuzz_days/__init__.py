"""Days of measurement at the edge of sense, through every command: nothing may end in a traceback."""
