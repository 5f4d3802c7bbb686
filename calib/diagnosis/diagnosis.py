"""What a diagnosis found, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass

from calib.arrays import Array, Mask
from calib.diagnosis.candidates import Candidate, NotAsked
from calib.diagnosis.causes import Cause, GapPlace, VerdictName
from calib.diagnosis.contest import Outcome
from calib.diagnosis.detection_limit import Hidden
from calib.diagnosis.finding import Refused
from calib.diagnosis.gap import Gap
from calib.diagnosis.imitated import Imitated
from calib.diagnosis.rest import Rest
from calib.diagnosis.sides import SideShare
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise_level import Growth, NoiseLevel
from calib.poses import Measurements
from calib.result import Result

_MOST = 5  # places that a summary names


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """Result of :func:`diagnose`.

    imitated : tuple of Imitated, causes that parameters of the user's model stand for
    sides : tuple of SideShare, of camera, board and arm, empty without a camera
    rest : Rest, what remains beside the causes
    outlier : ndarray of bool, shape (m,), poses that were left out; statistic, limit : judged by
    waiting : ndarray of bool, shape (m,), poses from before the first move, left out where approaches
        follow from the order: the arm came there from a side that nothing tells
    not_asked : causes that the table's columns cannot speak of
    refused : what the contest held and what is not named all the same
    before, after : Fit, of the user's model and with all that was found; stage : what they fit
    linear : Stage, the same to first order
    suspects : tuple of Candidate, all that was asked; outcome : Outcome, of the contest
    growth : Growth, of the noise with range, None where the residual shows none
    scale : float, actual over the standard deviation that the stage weighs by
    """

    verdict: VerdictName
    noise: NoiseLevel
    causes: tuple[Cause, ...]
    imitated: tuple[Imitated, ...]
    sides: tuple[SideShare, ...]
    rest: Rest
    located: tuple[GapPlace, ...]
    gap: Gap
    hidden: tuple[Hidden, ...]
    not_asked: tuple[NotAsked, ...]
    refused: tuple[Refused, ...]
    data: Measurements
    outlier: Mask
    waiting: Mask
    statistic: Array
    limit: float
    before: Fit
    after: Fit
    outcome: Outcome
    stage: Stage
    linear: Stage
    suspects: tuple[Candidate, ...]
    heldout: Measurements | None
    growth: Growth | None
    scale: float

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
