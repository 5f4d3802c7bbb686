"""Criteria by name: one class each, and one entry here."""

from __future__ import annotations

from doe.criteria.determinant import Determinant, Subset
from doe.criteria.eigenvalue import SmallestEigenvalue
from doe.criteria.protocol import Conic, Criterion, Question
from doe.criteria.smallest import Rivals, WorstRegion, WorstTask
from doe.criteria.trace import Average, Combination, Task

CRITERIA: dict[str, type[Criterion]] = {
    "task": Task,
    "task-worst": WorstTask,
    "D": Determinant,
    "Ds": Subset,
    "A": Average,
    "c": Combination,
    "E": SmallestEigenvalue,
    "G": WorstRegion,
    "discriminate": Rivals,
}

__all__ = ["CRITERIA", "Conic", "Criterion", "Question"]
