"""The verb: is what was measured enough, what does the rest of the plan bring, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell import Cell
from calib.errors import EffectCannotAct, TooFewPoses
from calib.identification import Identification
from calib.identification.identify import after_the_first_move, identify
from calib.identification.noise import believed_sigma
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.poses import Measurements, Poses
from calib.result import Result
from calib.scatter import Variances
from calib.threads import one_blas_thread
from doe.curve import stops_paying
from doe.forecast.accuracy import (
    ForecastStep,
    LastingError,
    TaskError,
    lasting_error,
    most_useful_first,
)
from doe.forecast.coming import Match, feasible, match, rows_of, whole_day
from doe.information import Linearisation, nominal
from doe.plan import named

_CANDIDATES = 1000
_MOST_FRESH = 30


@dataclass(frozen=True, eq=False, repr=False)
class Enough(Result):
    """What is known now, and what each further pose of the plan is going to add.

    model : Model, of the whole day
    found : Identification of the data so far, None where they do not suffice for one; why : str
    sigma : float, m, standard deviation of a coordinate, as the data show it
    footprint : float, metres to one unit of the readings: 1 where any is a length, else of a pixel
    match : Match, which readings of the plan are done
    steps : tuple of ForecastStep, the first one now, then the poses still to come in the best order
    goal : float, m, or None
    lacking : LastingError, what no reading of these poses lowers
    fresh : tuple of ForecastStep, poses beyond the plan until the goal is reached; empty where not
        asked
    """

    model: Model
    found: Identification | None
    why: str
    sigma: float
    footprint: float
    match: Match
    steps: tuple[ForecastStep, ...]
    goal: float | None
    lacking: LastingError
    fresh: tuple[ForecastStep, ...]

    def sentences(self) -> list[str]:
        if self.found is None:
            return [f"Enough: the readings so far do not suffice: {self.why}"]
        now, end = self.steps[0], self.steps[-1]
        said = f"Enough: expected error at the targets {1e3 * now.task_rms:.3g} mm RMS now"
        if len(self.steps) > 1:
            said += (
                f", {1e3 * end.task_rms:.3g} mm after the {len(self.steps) - 1} poses still to come"
            )
        if self.goal is None:
            return [said]
        goal = f"goal {1e3 * self.goal:.3g} mm: "
        if self.beyond_reach:
            return [said, goal + "no number of poses meets it, as the model lacks something"]
        needed = self.needed
        if needed is None:
            return [said, goal + "out of reach of these poses"]
        return [
            said,
            goal + (f"met after {needed} poses more" if needed else "met, 19 times in 20"),
        ]

    def rows(self) -> list[dict[str, object]]:
        return [
            {
                "pose": step.pose or "",
                "readings": step.readings,
                "task_rms_mm": 1e3 * step.task_rms,
                "task_worst_mm": 1e3 * step.task_worst,
            }
            for step in (*self.steps, *self.fresh)
        ]

    def reaches(self, step: ForecastStep) -> bool:
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


@one_blas_thread
def enough(
    cell: Cell,
    data: Measurements,
    plan: Poses | None = None,
    *,
    heldout: Measurements | None = None,
    goal: float | None = None,
    seed: int = 0,
) -> Enough:
    """Say what the data tell, and what the rest of a plan adds, pose by pose in the best order.

    data : the readings so far; poses of the plan among them are found by their joints, or their names
    plan : the plan that is being measured, None for the data alone
    heldout : poses that take no part: what they miss by is expected elsewhere, too
    goal : expected RMS error at the targets that is wanted, m
    seed : of the fresh candidates by which poses beyond the plan are judged

    The order is greedy: each pose is the one that lowers the expected error most beside those before
    it. The noise is what the data show; outliers count nothing. Time, temperature and approach of what
    is to come follow the data and the plan's order, whatever the order here. What the model lacks is
    taken from held-out poses, else from the first and the last readings, each predicted by the others.

    Raises CalibError where the whole plan would not do.
    """
    plan = data.poses.take([]) if plan is None else plan
    done = match(cell, plan, data.poses)
    try:
        found, why = identify(cell, data, heldout=heldout), ""
    except (TooFewPoses, EffectCannotAct) as error:
        found, why = None, str(error)
    readings, pose = whole_day(cell, data, plan, done.left)
    arm, at = _linearised(cell, readings.poses, found)
    lacking = lasting_error(cell, at.model, at.values, arm, found)
    day, task = Day.of(at, readings, pose, found), TaskError.at(at, lacking, found)
    steps = tuple(day.steps(task, day.order(task), plan.names))
    model, read = at.model, day.data
    footprint = model.footprint(at.values, data)
    sigma = believed_sigma(read, at.weights(read), model.readout.channels.lengths) * arm.scale
    result = Enough(model, found, why, sigma * footprint, footprint, done, steps, goal, lacking, ())
    known_after_all = result.needed is not None or result.beyond_reach
    unplanned = any(e.uses for e in model.effects) or any(i.touches for i in cell.instruments)
    if goal is None or known_after_all or unplanned:
        return result
    q = day.fresh(task, seed)
    if not len(q):
        return result
    names = [f"fresh{k + 1}" for k in range(len(q))]
    further = Day.of(at, *whole_day(cell, read, named(q)), found)
    _, *beyond = further.steps(task, range(len(q)), names)
    met = [k + 1 for k, step in enumerate(beyond) if result.reaches(step)]
    return replace(result, fresh=tuple(beyond[: met[0]] if met else beyond))


def _linearised(
    cell: Cell, poses: Poses, found: Identification | None
) -> tuple[Variances, Linearisation]:
    """How the arm scatters, and the model of the whole day to first order, as identified so far.

    Readings count with scatter that was not found, as the identification has it.
    """
    model = build(cell, poses).model
    if found is not None:  # with what the readings leave to be believed of type, sizes and noise
        model = replace(model, prior=found.model.prior, noise_scales=found.model.noise_scales)
    refuse_idle_effects(cell, model, poses)
    values = nominal(model, poses)
    arm = hidden = Variances.of_arm(model.robot.dof, cell.repeatability)
    if found is not None:
        known = dict(zip((p.id for p in found.model.parameters), found.values, strict=True))
        values = np.array(
            [known.get(p.id, v) for p, v in zip(model.parameters, values, strict=True)]
        )
        arm = arm if found.levels is None else found.levels.variances
        arm = arm if arm.any else replace(arm, scale=found.noise.divisor)
        hidden = arm if found.undetected is None else found.undetected[1].variances
    return arm, Linearisation(cell, model, values, hidden)


@dataclass(frozen=True, eq=False)
class Day:
    """Readings in hand and to come, to first order.

    data : Measurements, those to come where they are expected; pose : ndarray of int, shape (m,), of
        what is to come, -1 for what is in hand
    known : LinearProblem, of all of them and what is known beside
    """

    at: Linearisation
    data: Measurements
    pose: IntArray
    known: LinearProblem

    @classmethod
    def of(
        cls, at: Linearisation, data: Measurements, pose: IntArray, found: Identification | None
    ) -> Day:
        """Points of what is to come are those expected after what is measured: noise has a range."""
        expected = at.model.predict(at.values, data.poses)
        points = np.where((pose >= 0)[:, None, None], expected, data.readings)
        data = after_the_first_move(at.model, replace(data, readings=points))
        kept = np.ones(len(data), dtype=bool)
        # By how much more what is believed weighs beside arms that scatter, as it does in the estimate.
        pull = 1.0
        if found is not None:
            kept[: len(found.fit.outlier)] = ~found.fit.outlier
            pull = found.prior_weight if at.arm.any else found.prior_weight / found.noise.divisor
        known = replace(at.of(data, kept), prior_weight=pull)
        arm = Variances.of_arm(at.model.robot.dof, at.cell.repeatability)
        if arm.any:  # the estimate weighs whole poses as the cell says that the arm scatters
            known = replace(known, weighing=replace(at, arm=arm).of(data, kept).mixing)
        return cls(at, data, pose, known)

    def steps(
        self, task: TaskError, order: Iterable[int], names: Sequence[str]
    ) -> Iterator[ForecastStep]:
        """What is known now, then with each further pose."""
        done = self.pose < 0
        for k in (-1, *order):
            done = done | (self.pose == k)
            read = replace(self.known, J=self.known.J * done[:, None, None])
            yield task.expected(names[k] if k >= 0 else None, int(done.sum()), read)

    def order(self, task: TaskError) -> list[int]:
        """The poses still to come, each the one that adds most beside those before it."""
        poses = np.unique(self.pose[self.pose >= 0])
        each = [stacked(self.known.by_reading[self.pose == k]) for k in poses]
        most = max(map(len, each), default=0)
        rows = [np.pad(own, ((0, most - len(own)), (0, 0))) for own in each]
        return [int(poses[i]) for i in self._best(task, self.pose < 0, rows, len(rows))]

    def fresh(self, task: TaskError, seed: int) -> Array:
        """Joint values of poses beyond the plan, (n, dof): those that add most come first."""
        q = feasible(self.at.cell, self.data, _CANDIDATES, seed)
        rows = rows_of(self.at, self.data, q) if len(q) else q
        return q[self._best(task, np.full(len(self.pose), True), rows, _MOST_FRESH)]

    def _best(
        self, task: TaskError, done: Mask, rows: Sequence[Array] | Array, count: int
    ) -> list[int]:
        """So many poses of these rows, the most useful first, beside some of the readings."""
        if not len(rows):
            return []
        beside = np.concatenate([stacked(self.known.by_reading[done]), self.known.held])
        sizes = task.model.sizes
        return most_useful_first(task.targets, beside, np.asarray(rows), sizes, count)
