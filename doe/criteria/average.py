"""A: mean variance of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from doe.criteria.protocol import Question
from doe.criteria.trace import Trace


@dataclass(frozen=True, eq=False)
class Average(Trace):
    """A: trace of the covariance, of all parameters or of those that matter, in their units."""

    name: ClassVar[str] = "A"
    unit: ClassVar[str] = "trace of the covariance, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.shown[question.chosen].T)
