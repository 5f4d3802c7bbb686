"""G: the worst predicted pose within the joint limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from doe.criteria.protocol import Question
from doe.criteria.smallest import WorstVariance


@dataclass(frozen=True, eq=False)
class WorstRegion(WorstVariance):
    """G: largest variance of a predicted reading, summed over its markers, in noise variances."""

    name: ClassVar[str] = "G"
    unit: ClassVar[str] = "largest variance of a predicted pose, in noise variances"

    @classmethod
    def of(cls, question: Question) -> Self:
        values, vectors = np.linalg.eigh(question.region)
        return cls(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
