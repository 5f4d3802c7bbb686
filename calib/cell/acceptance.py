"""What a cell asks of held-out points: a tolerance, and the rule by which one is within it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arrays import Array

Rule = Literal["simple", "guarded"]
Verdict = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True)
class Acceptance:
    """What a cell asks for.

    tolerance : float, m, of the distance of each point; rule : how a point is judged by it
    """

    tolerance: float
    rule: Rule

    def judge(self, distances: Array, expanded: Array) -> list[Verdict]:
        """Each of the distances (n,), m, whose expanded uncertainties are (n,), m."""
        guard = expanded if self.rule == "guarded" else np.zeros_like(expanded)
        passed, failed = distances + guard <= self.tolerance, distances - guard > self.tolerance
        return [
            "pass" if p else "fail" if f else "undecided"
            for p, f in zip(passed, failed, strict=True)
        ]
