"""c: one parameter, or one linear combination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.errors import CalibError
from doe.criteria.protocol import Question
from doe.criteria.trace import Trace


@dataclass(frozen=True, eq=False)
class Combination(Trace):
    """c: variance of one parameter or of one linear combination, in its units."""

    name: ClassVar[str] = "c"
    unit: ClassVar[str] = "variance of the combination, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        if question.direction is None:
            raise CalibError(
                "criterion c needs one parameter or combination; say which (of), as NAME[=FACTOR],.."
            )
        return cls((question.direction @ question.shown)[:, None])
