"""The parts of the benchmark: each draws its days by their numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from studies.research.benchmarks.conclusions.days import Day
from studies.research.benchmarks.conclusions.parts import arm_a, foreign, hard, nothing, outside

Draw = Callable[[np.random.Generator, int], Day]

DRAWS: dict[str, Draw] = {
    "arm_a": arm_a.draw,
    "nothing": nothing.draw,
    "loud": nothing.draw_loud,
    "foreign": foreign.draw,
    "hard": hard.draw,
    "outside": outside.draw,
}
KINDS: dict[str, tuple[str, ...]] = {
    "foreign": foreign.KINDS,
    "hard": hard.KINDS,
    "outside": outside.KINDS,
}
"""Kinds that take turns from day to day."""
