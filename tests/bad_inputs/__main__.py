"""Print the list of bad inputs with what is said to each: ``python -m tests.bad_inputs``."""

from __future__ import annotations

from tests.bad_inputs.run import listed

print(listed(), end="")
