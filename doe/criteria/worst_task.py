"""task-worst: accuracy at the worst target pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from doe.criteria.protocol import Question
from doe.criteria.smallest import WorstVariance


@dataclass(frozen=True, eq=False)
class WorstTask(WorstVariance):
    """Expected squared position error at the worst target pose, shown as its root in mm."""

    name: ClassVar[str] = "task-worst"
    unit: ClassVar[str] = "mm RMS at the worst target"

    @classmethod
    def of(cls, question: Question) -> Self:
        rows = question.targets()[question.target_weights > 0.0]
        return cls(np.swapaxes(rows, -1, -2))

    def shown(self, value: float) -> float:
        return 1e3 / float(np.sqrt(value))
