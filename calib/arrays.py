"""The kinds of arrays that pass from hand to hand; shapes and units stand where they are used."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Figures, in SI and radians."""

IntArray: TypeAlias = NDArray[np.int_]
"""Positions, counts and groups."""

Mask: TypeAlias = NDArray[np.bool_]
"""Which of something: poses, markers, candidates, parameters."""
