"""What a diagnosis found, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass

from calib.arrays import Array, Mask
from calib.diagnosis.candidates import Candidate, NotAsked
from calib.diagnosis.contest import Outcome
from calib.diagnosis.gap import Gap
from calib.diagnosis.hidden import Hidden
from calib.diagnosis.named import Named
from calib.diagnosis.probability import Evidence
from calib.diagnosis.range_noise import Growth
from calib.diagnosis.refused import Refused
from calib.diagnosis.rest import Rest
from calib.diagnosis.shape import Doubt
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.standing import Standing, VerdictName
from calib.identification.noise_level import NoiseLevel
from calib.poses import Measurements


@dataclass(frozen=True, eq=False)
class Cause:
    """An effect of the catalogue that was found.

    values, std : ndarray, shape (k,), SI, std NaN where the data do not determine the value
    p : float, over all that was asked
    share : float, of the gap, NaN where there is none
    evidence : Evidence, what speaks for and against it
    standing : how sure it is
    far_out : str, what of it is larger than such errors usually are, empty where nothing is
    """

    named: Named
    doubt: Doubt
    values: Array
    std: Array
    p: float
    share: float
    evidence: Evidence
    standing: Standing
    far_out: str = ""

    @property
    def members(self) -> tuple[tuple[Candidate, float], ...]:
        """Causes that the data cannot tell apart, with probabilities, best first."""
        return tuple((c, self.evidence.probability * share) for c, share in self.named.members)

    @property
    def misshapen(self) -> bool:
        """Whether the cause is there in another form than the catalogue's."""
        return self.doubt.stands

    @property
    def displaced(self) -> bool:
        """Whether nothing of the cause is needed beside what its size varies with."""
        return self.misshapen and not self.doubt.also_there


@dataclass(frozen=True)
class Place:
    """Where a part of the gap sits, and on what it depends."""

    where: str
    depends_on: str
    share: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of :func:`diagnose`.

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
    rest: Rest
    located: tuple[Place, ...]
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
