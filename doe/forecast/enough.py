"""The verb: is what was measured enough, what does the rest of the plan bring, and in which order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import IntArray, stacked
from calib.cell import Cell
from calib.errors import CalibError, EffectCannotAct, TooFewPoses
from calib.identification import Identification
from calib.identification.identify import after_the_first_move, identify
from calib.identification.noise import believed_sigma
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.observations.scatter import Variances
from calib.poses import Measurements, Poses, poses_at
from calib.result import Result
from calib.threads import one_blas_thread
from doe.candidates import candidates_of
from doe.constraints import constraints_of
from doe.forecast.accuracy import (
    ForecastStep,
    LastingError,
    TaskError,
    most_useful_first,
)
from doe.forecast.coming import Match, match, whole_day
from doe.information import Linearisation, Rows, nominal

_MOST_FRESH, _DRAWN = 30, 256  # poses beyond the plan, and those they are the first allowed of


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
        errors = [f"{1e3 * step.task_rms:.3g} mm" for step in (self.steps[0], self.steps[-1])]
        coming = f", {errors[1]} after the {len(self.steps) - 1} poses still to come"
        now = f"Enough: expected error at the targets {errors[0]} RMS now"
        sentences = [now + coming * (len(self.steps) > 1)]
        if self.goal is not None:
            verdict = "out of reach of these poses"
            if self.beyond_reach:
                verdict = "no number of poses meets it, as the model lacks something"
            elif self.needed is not None:
                verdict = f"met after {self.needed} poses more, 19 times in 20"
            sentences.append(f"goal {1e3 * self.goal:.3g} mm: {verdict}")
        return sentences

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
        return next((k for k, step in enumerate(self.steps) if self.reaches(step)), None)

    @property
    def fresh_needed(self) -> int | None:
        """How many poses beyond the plan the goal needs; None if more than were tried."""
        return next((k for k, step in enumerate(self.fresh, 1) if self.reaches(step)), None)


@one_blas_thread
def enough(
    cell: Cell,
    data: Measurements,
    plan: Poses | None = None,
    *,
    heldout: Measurements | None = None,
    goal: float | None = None,
) -> Enough:
    """Judge whether the data suffice, and what the rest of a plan adds, pose by pose.

    data : the readings so far; poses of the plan among them are recognised by joints, or by names
    plan : the plan that is being measured, None for the data alone
    heldout : poses that take no part: what they miss by is expected elsewhere, too
    goal : expected RMS error at the targets that is wanted, m

    The order is greedy: each pose is the one that lowers the expected error most beside those before
    it. The noise is what the data show; outliers count nothing. Time, temperature and approach of what
    is to come follow the data and the plan's order, whatever the order here. What the model lacks is
    taken from held-out poses, else from each configuration as the others predict it, and from the trend
    of the day. Poses beyond the plan are drawn as its candidates are.

    Raises CalibError where the whole plan would not do, or where nothing was read.
    """
    if not len(data):
        raise CalibError("nothing was read yet; design, compare and foresee judge a plan")
    plan = data.poses.take([]) if plan is None else plan
    done = match(cell, plan, data.poses)
    try:
        found, why = identify(cell, data, heldout=heldout), ""
    except (TooFewPoses, EffectCannotAct) as error:
        found, why = None, str(error)
    readings, pose = whole_day(cell, data, plan, done.left)
    at = _linearised(cell, readings.poses, found)
    lacking = LastingError.of(at, found)
    read, rows = _rows(at, readings, pose, found)
    task, model = TaskError.at(at, lacking, found), at.model
    steps = tuple(_steps(task, rows, pose, plan.names))
    footprint = model.footprint(at.values, read)
    sigma = believed_sigma(read, at.weights(read), model.readout.channels.lengths) * at.arm.scale
    result = Enough(model, found, why, sigma * footprint, footprint, done, steps, goal, lacking, ())
    settled = goal is None or result.needed is not None or result.beyond_reach
    unplanned = any(e.uses for e in model.effects) or any(i.touches for i in cell.instruments)
    if settled or unplanned:
        return result
    fresh = tuple(_beyond(at, task, readings, found))
    return replace(result, fresh=fresh[: replace(result, fresh=fresh).fresh_needed])


def _linearised(cell: Cell, poses: Poses, found: Identification | None) -> Linearisation:
    """The model of the whole day to first order, as identified so far.

    Readings count with scatter that was not detected, as the identification has it.
    """
    model = build(cell, poses).model
    if found is not None:  # with what the readings leave to be believed of type, sizes and noise
        model = replace(model, prior=found.model.prior, noise_scales=found.model.noise_scales)
    refuse_idle_effects(cell, model, poses)
    values = nominal(model, poses)
    arm = Variances.of_arm(model.robot.dof, cell.repeatability)
    if found is not None:
        known = dict(zip((p.id for p in found.model.parameters), found.values, strict=True))
        pairs = zip(model.parameters, values, strict=True)
        values = np.array([known.get(p.id, v) for p, v in pairs])
        arm = arm if found.levels is None else found.levels.variances
        arm = arm if arm.any else replace(arm, scale=found.noise.divisor)
        arm = arm if found.undetected is None else found.undetected[1].variances
    return Linearisation(cell, model, values, arm)


def _rows(
    at: Linearisation, data: Measurements, pose: IntArray, found: Identification | None
) -> tuple[Measurements, Rows]:
    """All readings of the day, those to come where they are expected, and their rows.

    pose : ndarray of int, shape (m,), of what is to come, -1 for what is in hand
    """
    expected = at.model.predict(at.values, data.poses)  # noise has a range
    points = np.where((pose >= 0)[:, None, None], expected, data.readings)
    data = after_the_first_move(at.model, replace(data, readings=points))
    kept, pull = np.ones(len(data), dtype=bool), 1.0
    if found is not None:
        kept[: len(found.fit.outlier)] = ~found.fit.outlier
        # What is believed weighs more beside arms that scatter, as it does in the estimate.
        pull = found.prior_weight if at.arm.any else found.prior_weight / found.noise.divisor
    # The estimate weighs whole poses as the cell says that the arm scatters.
    stated = Variances.of_arm(at.model.robot.dof, at.cell.repeatability)
    weighing = stated if stated.any else None
    return data, replace(at.of(data, kept), pull=pull, weighing=weighing)


def _steps(
    task: TaskError, rows: Rows, pose: IntArray, names: Sequence[str]
) -> Iterator[ForecastStep]:
    """What is known now, then with each further pose, the most useful first."""
    done = pose < 0
    now, to_come = rows.take(done).problem, np.unique(pose[~done])
    yield task.expected(None, int(done.sum()), now)
    if not len(to_come):
        return
    each = [stacked(rows.take(pose == k).problem.rows()) for k in to_come]
    most = max(map(len, each))
    padded = np.array([np.pad(J, ((0, most - len(J)), (0, 0))) for J in each])
    known = np.concatenate([stacked(now.rows()), now.held])
    for i in most_useful_first(task.weighed, known, padded, task.model.sizes):
        done = done | (pose == to_come[i])
        yield task.expected(names[to_come[i]], int(done.sum()), rows.take(done).problem)


def _beyond(
    at: Linearisation, task: TaskError, day: Measurements, found: Identification | None
) -> Iterator[ForecastStep]:
    """What is known with each of more poses that are drawn as candidates are."""
    pool = candidates_of(at.cell, constraints_of(at.cell), None, _DRAWN, 0)
    names = tuple(f"fresh{k}" for k in range(1, _MOST_FRESH + 1))
    more, pose = whole_day(at.cell, day, poses_at(pool.q[:_MOST_FRESH], names=names[: len(pool)]))
    _, rows = _rows(at, more, pose, found)
    for k in range(min(len(pool), _MOST_FRESH)):
        done = pose <= k
        yield task.expected(names[k], int(done.sum()), rows.take(done).problem)
