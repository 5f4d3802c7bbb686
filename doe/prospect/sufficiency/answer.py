"""The answer: what is known, what is to come, and where the goal is met."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array
from calib.compensation.unexplained import Unexplained, Unseen
from calib.identification import Identification
from calib.model import Model
from calib.uncertainty.pose_to_pose import Owner
from doe.curve import stops_paying
from doe.prospect.sufficiency.forecast import Step
from doe.prospect.sufficiency.match import Match


@dataclass(frozen=True)
class Lacking:
    """The error at the targets that does not average away, RMS, m.

    scatter : the arm errs anew at every target; what the data do not tell from the model's lacks counts
        here
    unfollowed : what the model does not follow from pose to pose; unexplained : what it lacks beside it
    trend : how far the trend of the day will have gone when the arm comes to the targets; an_hour_on :
        and an hour later; None where no clock tells
    seen : what poses showed that the fit was without, zero where there are none
    rest_of : whose what differs from configuration to configuration is
    surely : whether what the model lacks is more than chance
    after : s after the last reading at which the arm comes to the targets; None where nobody says it
    """

    scatter: float
    unfollowed: float
    unexplained: Unexplained
    trend: float
    an_hour_on: float | None
    seen: Unseen
    rest_of: Owner = "instrument"
    surely: bool = False
    after: float | None = None

    @property
    def of_model(self) -> float:
        """What the model lacks, but for the trend."""
        return float(np.hypot(self.unfollowed, self.unexplained.rms))

    @property
    def rms(self) -> float:
        """All of it."""
        return float(np.linalg.norm([self.scatter, self.of_model, self.trend]))


@dataclass(frozen=True, eq=False)
class Enough:
    """What is known now, and what each further pose of the plan is going to add.

    model : Model, of the whole day
    found : Identification of the data so far, None where they do not suffice for one; why : str
    sigma : float, m, standard deviation of a coordinate, as the data show it
    match : Match, which readings of the plan are done
    steps : tuple of Step, the first one now, then the poses still to come in the best order
    goal : float, m, or None
    lacking : Lacking, what no reading of these poses lowers
    fresh : tuple of Step, poses beyond the plan until the goal is reached, empty where not asked
    fresh_q : ndarray, shape (n, dof), rad or m, their joint values
    """

    model: Model
    found: Identification | None
    why: str
    sigma: float
    match: Match
    steps: tuple[Step, ...]
    goal: float | None
    lacking: Lacking
    fresh: tuple[Step, ...]
    fresh_q: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def reaches(self, step: Step) -> bool:
        """Whether the goal is met, 19 times in 20, and nothing is open that the plan determines."""
        met = self.goal is not None and step.task_most <= self.goal
        return met and set(step.open) <= set(self.steps[-1].open)

    @property
    def beyond_reach(self) -> bool:
        """Whether no number of poses meets the goal."""
        return self.goal is not None and self.goal <= self.lacking.rms

    @property
    def needed(self) -> int | None:
        """How many of the poses still to come the goal needs; None where it is out of their reach."""
        found = [k for k, step in enumerate(self.steps) if self.reaches(step)]
        return found[0] if found else None

    @property
    def fresh_needed(self) -> int | None:
        """How many poses beyond the plan the goal needs; None if more than were tried."""
        found = [k + 1 for k, step in enumerate(self.fresh) if self.reaches(step)]
        return found[0] if found else None

    @property
    def pays_until(self) -> int | None:
        """Poses still to come after which more of them only average noise; None while some is open."""
        settled = [step for step in self.steps if not set(step.open) - set(self.steps[-1].open)]
        at = stops_paying([s.readings for s in settled], [s.task_rms for s in settled])
        return next(
            (k for k, s in enumerate(self.steps) if s.readings == at and s in settled), None
        )
