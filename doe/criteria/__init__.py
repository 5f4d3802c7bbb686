"""Criteria by name: one class each, and one entry here.

A user's criterion is the same small class in an installed package of theirs, announced under
``[project.entry-points."posecal.criteria"]`` by its name.
"""

from __future__ import annotations

from functools import lru_cache

from calib.plugins import with_announced
from doe.criteria.determinant import Determinant, Subset
from doe.criteria.protocol import Criterion, Question
from doe.criteria.smallest import Rivals, SmallestEigenvalue, WorstRegion
from doe.criteria.trace import Average, Combination, Task

CRITERIA: dict[str, type[Criterion]] = {
    "task": Task,
    "D": Determinant,
    "Ds": Subset,
    "A": Average,
    "c": Combination,
    "E": SmallestEigenvalue,
    "G": WorstRegion,
    "discriminate": Rivals,
}

UNASKED = "discriminate"
"""Not chosen by name, but by the effects to tell apart."""


@lru_cache(maxsize=1)
def catalogue() -> dict[str, type[Criterion]]:
    """All criteria by name, ours and those of installed packages.

    Raises CalibError where a package announces something that is no criterion.
    """
    return with_announced("criteria", CRITERIA, Criterion, lambda kind: kind.name)


__all__ = ["CRITERIA", "UNASKED", "Criterion", "Question", "catalogue"]
