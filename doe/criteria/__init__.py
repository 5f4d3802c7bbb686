"""Criteria by name: one file each, and one entry here."""

from __future__ import annotations

from doe.criteria.average import Average
from doe.criteria.combination import Combination
from doe.criteria.determinant import Determinant
from doe.criteria.eigenvalue import SmallestEigenvalue
from doe.criteria.protocol import Conic, Criterion, Question
from doe.criteria.region import WorstRegion
from doe.criteria.rivals import Rivals
from doe.criteria.subset import Subset
from doe.criteria.task import Task
from doe.criteria.worst_task import WorstTask

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
