"""The verb: is what was measured enough, what does the rest of the plan bring, and in which order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib.api import readings
from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell import Cell
from calib.errors import CalibError, EffectCannotAct, TooFewPoses
from calib.identification import Identification
from calib.identification.identify import after_the_first_move, identify
from calib.identification.noise_level import believed_sigma
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.poses import Measurements, Poses, poses_at
from calib.result import Result
from calib.scatter import Variances
from calib.threads import one_blas_thread
from doe.ahead.error_floor import ErrorFloor, error_floor
from doe.ahead.forecast import (
    Forecast,
    ForecastStep,
    NormalEquations,
    Readings,
    best_next,
    regularised,
)
from doe.ahead.remaining import Match, match, whole_day
from doe.ahead.situation import likely_read, refusal
from doe.constraints import constraints_of, scene_of, visible
from doe.criteria import Criterion
from doe.curve import stops_paying
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from doe.problem.linearisation import Linearisation, Regressor, nominal
from doe.problem.pool import drawn, pool_of

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
    lacking : ErrorFloor, what no reading of these poses lowers
    fresh : tuple of ForecastStep, poses beyond the plan until the goal is reached; empty where not
        asked
    fresh_q : ndarray, shape (n, dof), rad or m, their joint values
    """

    model: Model
    found: Identification | None
    why: str
    sigma: float
    footprint: float
    match: Match
    steps: tuple[ForecastStep, ...]
    goal: float | None
    lacking: ErrorFloor
    fresh: tuple[ForecastStep, ...]
    fresh_q: Array = field(default_factory=lambda: np.zeros((0, 0)))

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
                "pose": step.pose,
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
    fresh: int = 0,
    ahead: int = 0,
    missed: Poses | None = None,
    seed: int = 0,
) -> Enough:
    """Say what the data tell, and what the rest of a plan adds, pose by pose in the best order.

    data : the readings so far; poses of the plan among them are found by their joints, or their names
    plan : the plan that is being measured, None for the data alone
    heldout : poses that take no part: what they miss by is expected elsewhere, too
    goal : expected RMS error at the targets that is wanted, m
    fresh : so many poses beyond the plan are chosen whatever the goal
    ahead : so many, the fresh ones among them, are still to be read: they are chosen together
    missed : poses that could not be read: what is nearer to them than to any that was is not chosen
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
    arm, at, day = _linearised(cell, data, whole_day(cell, data, plan, done.left), found)
    model = at.model
    lacking = error_floor(cell, model, at.values, arm, found)
    forecast = Forecast.at(at, lacking, found)
    kept = np.ones(len(day), dtype=bool)
    if found is not None:
        kept[: len(found.fit.outlier)] = ~found.fit.outlier
    rows = Readings.at(at, day, kept)
    # By how much more what is believed weighs beside arms that scatter, as it does in the estimate.
    pull = 1.0 if found is None else found.pull
    if found is not None and not at.arm.any:
        pull /= found.noise.divisor
    rows = rows.with_prior(model.prior_residuals(at.values)[1] * model.sizes, pull)
    so_far = np.arange(len(day)) < len(data)
    order = _best_order(forecast.criterion, rows.rows, so_far, plan, done.left)
    further = ((name, count, rows.equations(upto)) for name, count, upto in order)
    steps = tuple(forecast.steps(rows.equations(so_far), len(data), further))
    footprint = model.footprint(at.values, data)
    sigma = believed_sigma(day, at.weights(day), model.readout.channels.lengths) * arm.scale
    result = Enough(model, found, why, sigma * footprint, footprint, done, steps, goal, lacking, ())
    known_after_all = result.needed is not None or result.beyond_reach
    unasked = not fresh and (goal is None or known_after_all)
    if unasked or any(e.uses for e in model.effects):
        return result
    whole = rows.equations()
    regressor = Regressor.nominal(cell, model, at.values)
    pool = pool_of(
        regressor, constraints_of(cell), None, drawn(cell, _CANDIDATES, None, seed), _CANDIDATES
    )
    if missed is not None:
        pool = pool.where(likely_read(cell.robot, pool.q, data.poses, missed))
        if not len(pool):
            raise CalibError(refusal(missed))
    blocks = Blocks(pool.packed / arm.scale**2, whole.root.T @ whole.root, regressor.rank)
    chosen = _together(forecast.criterion, blocks, fresh, ahead, seed)
    beyond, index = _fresh(pool.q, blocks, forecast, at, whole, result, fresh, chosen)
    return replace(result, fresh=beyond, fresh_q=pool.q[index])


def _linearised(
    cell: Cell, data: Measurements, day: Measurements, found: Identification | None
) -> tuple[Variances, Linearisation, Measurements]:
    """How the arm scatters, and the whole day to first order, linearised as identified so far.

    Readings count with scatter that was not found, as the identification has it.
    """
    model = build(cell, day.poses).model
    if found is not None:  # with what the readings leave to be believed of type, sizes and noise
        model = replace(model, prior=found.model.prior, noise_scales=found.model.noise_scales)
    refuse_idle_effects(cell, model, day.poses)
    values = nominal(model, day.poses)
    if found is not None:
        ids = [[p.id for p in own.parameters] for own in (found.model, model)]
        known = dict(zip(ids[0], found.values, strict=True))
        values = np.array([known.get(i, v) for i, v in zip(ids[1], values, strict=True)])
    # Points where they are expected after those that are measured: noise has a range.
    predicted = model.predict(values, day.poses)[len(data) :]
    day = replace(day, readings=np.concatenate([day.readings[: len(data)], predicted]))
    day = after_the_first_move(model, day)
    arm = Variances.of_arm(model.robot.dof, cell.repeatability)
    if found is not None:
        arm = arm if found.levels is None else found.levels.variances
        arm = arm if arm.any else replace(arm, scale=found.noise.divisor)
    hidden = None if found is None else found.unnoticed
    counted = arm if hidden is None else hidden[1].variances
    return arm, Linearisation(cell, model, values, counted), day


def _best_order(
    criterion: Criterion, rows: LinearProblem, so_far: Mask, plan: Poses, left: IntArray
) -> Iterator[tuple[str, int, Mask]]:
    """The poses of which readings are still to come: name, how many, and all that is read by then.

    rows : LinearProblem, of the whole day
    """
    if not len(left):
        return
    poses, of = np.unique(left % len(plan), return_inverse=True)
    number = np.full(len(so_far), -1)
    number[~so_far] = of
    each, held = rows.by_reading, rows.held
    own = [stacked(each[number == k]) for k in range(len(poses))]
    known = stacked(each[so_far])
    packed = pack(np.stack([one.T @ one for one in own]))
    blocks = Blocks(packed, known.T @ known + held.T @ held, max(map(len, own)))
    done = so_far.copy()
    for k in best_next(criterion, blocks, len(own)):
        done = done | (number == k)
        yield plan.names[poses[k]], len(of[of == k]), done


def _together(criterion: Criterion, blocks: Blocks, fresh: int, ahead: int, seed: int) -> IntArray:
    """The best of as many candidates as are still to be read, those first that add most."""
    count = min(max(fresh, ahead), len(blocks))
    if count < 2 or not fresh:
        return np.zeros(0, dtype=int)
    beside = regularised(blocks)
    rules = Allowed.any_of(len(blocks), count)
    relaxed = relax(criterion, beside, rules)
    plan = best_plan(criterion, beside, rules, relaxed, seed=seed, thorough=False).plan
    return plan[best_next(criterion, blocks.take(plan), count)]


def _fresh(
    candidates: Array,
    blocks: Blocks,
    forecast: Forecast,
    at: Linearisation,
    known: NormalEquations,
    answer: Enough,
    wanted: int,
    chosen: IntArray,
) -> tuple[tuple[ForecastStep, ...], IntArray]:
    """Poses beyond the plan, those that are chosen or each the one that adds most, and which of the
    candidates (m, dof) they are.

    So many as are wanted, else until the goal is met or tried enough.
    """
    steps: list[ForecastStep] = []
    index: list[int] = []
    count = answer.steps[-1].readings
    while len(candidates) and len(steps) < (wanted or _MOST_FRESH):
        if len(steps) < len(chosen):
            index.append(int(chosen[len(steps)]))
        else:
            blocks = replace(blocks, fixed=known.root.T @ known.root)
            index.append(int(best_next(forecast.criterion, blocks, 1)[0]))
        q = candidates[index[-1:]]
        poses = readings(at.cell, poses_at(q, names=[""]))
        seen = np.tile(visible(scene_of(at.cell, q)), (len(poses), 1))
        points = at.model.predict(at.values, poses)
        read = Measurements(poses, points, seen, np.full(seen.shape, np.nan))
        known = known.combined(Readings.at(at, read).equations())
        *_, step = forecast.steps(known, count, [(f"fresh{len(steps) + 1}", len(poses), known)])
        count = step.readings
        steps.append(step)
        if not wanted and answer.reaches(step):
            break
    return tuple(steps), np.array(index, dtype=int)
