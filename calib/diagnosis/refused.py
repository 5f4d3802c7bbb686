"""Candidates that were selected and are not believed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from calib.diagnosis.candidates import Candidate

Why = Literal["configurations", "time", "nothing", "weak"]

_REASONS: dict[Why, str] = {
    "configurations": "configurations that are left out are predicted no better with it",
    "time": "stretches of time that are left out are predicted no better with it",
    "nothing": "in the fit in full it is smaller than its own standard deviation",
    "weak": "smaller than three of its own standard deviations: it is fitted, and not named",
}


@dataclass(frozen=True)
class Refused:
    """A candidate that was selected and not believed, and why.

    effect : str, of the catalogue, or ``curve over`` what a cause without a name depends on
    """

    effect: str
    where: str
    why: Why

    @property
    def reason(self) -> str:
        """Why, in words."""
        return _REASONS[self.why]

    @classmethod
    def of(cls, candidate: Candidate, why: Why) -> Refused:
        """A candidate refused."""
        name = candidate.effect.kind if candidate.named else f"curve over {candidate.depends_on}"
        return cls(name, candidate.where, why)
