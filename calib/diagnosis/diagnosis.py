"""What a diagnosis found, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass

from calib.arrays import Mask
from calib.diagnosis.candidates import Candidate, NotAsked
from calib.diagnosis.causes import Cause, GapPlace, VerdictName
from calib.diagnosis.detection_limit import Hidden
from calib.diagnosis.finding import Finding
from calib.diagnosis.gap import Gap
from calib.diagnosis.imitated import Imitated
from calib.diagnosis.rest import Rest
from calib.diagnosis.sides import SideShare
from calib.poses import Measurements
from calib.result import Result

_MOST = 5  # places that a summary names


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(Result, Finding):
    """Result of :func:`diagnose`: what was found, and what follows from it.

    imitated : tuple of Imitated, causes that parameters of the user's model stand for
    sides : tuple of SideShare, of camera, board and arm, empty without a camera
    rest : Rest, what remains beside the causes
    outlier : ndarray of bool, shape (m,), poses that were left out
    waiting : ndarray of bool, shape (m,), poses from before the first move, left out where approaches
        follow from the order: the arm came there from a side that nothing tells
    not_asked : causes that the table's columns cannot speak of
    """

    verdict: VerdictName
    causes: tuple[Cause, ...]
    imitated: tuple[Imitated, ...]
    sides: tuple[SideShare, ...]
    rest: Rest
    located: tuple[GapPlace, ...]
    gap: Gap
    hidden: tuple[Hidden, ...]
    not_asked: tuple[NotAsked, ...]
    outlier: Mask
    waiting: Mask
    heldout: Measurements | None

    @property
    def data(self) -> Measurements:
        """All that was read, what was left out included."""
        return self.stage.data

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """All that was asked."""
        return tuple(c for c in self.outcome.suspects if not c.echo)

    def sentences(self) -> list[str]:
        gap = self.gap
        errors = [f"fitted poses {_shrinks(gap.fit_before, gap.fit_after)}"]
        if gap.heldout_before is not None:
            errors.append(f"held out {_shrinks(gap.heldout_before, gap.heldout_after)}")
        if gap.crossed is not None:
            errors.append(f"cross-validated {_shrinks(*gap.crossed)}")
        places = () if self.causes else self.located[:_MOST]
        return [
            f"Diagnosis: {self.verdict}; what remains: {self.rest.kind}",
            f"RMS error: {', '.join(errors)}; noise {1e3 * gap.floor:.3g} mm",
            *(f"the model stands for {c.candidate.key}: {c.value:.3g}" for c in self.imitated),
            *(f"no cause named: {place!r}" for place in places),
        ]

    def rows(self) -> list[dict[str, object]]:
        return [
            {
                "cause": cause.name,
                "where": cause.where,
                "probability": cause.probability,
                "standing": cause.standing,
                "share_of_gap": cause.share,
            }
            for cause in self.causes
        ]


def _shrinks(before: float, after: float | None) -> str:
    return (
        f"{1e3 * before:.3g} mm" if after is None else f"{1e3 * before:.3g} -> {1e3 * after:.3g} mm"
    )
