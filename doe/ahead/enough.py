"""The verb: is what was measured enough, what does the rest of the plan bring, and in which order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib.api import readings
from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.compensation.estimate import Estimate, estimate_of, fitted_of
from calib.compensation.unexplained import (
    Unexplained,
    Unseen,
    at_ends,
    at_held_out,
    scatter_at,
)
from calib.effects.tool import Tool
from calib.errors import CalibError, EffectCannotAct, TooFewPoses
from calib.identification import Identification
from calib.identification.identify import after_the_first_move, identify
from calib.identification.noise_level import believed_sigma
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.model.covariance import at_points_read, at_tip, task_error
from calib.poses import Measurements, Poses, poses_at
from calib.scatter import Variances
from calib.scatter.poses import Mixing
from calib.threads import one_blas_thread
from calib.uncertainty.expanded import freedom
from calib.uncertainty.pose_to_pose import Owner, parted
from doe.ahead.forecast import Forecast, Step, Told, best_next, open_beside, told
from doe.ahead.lacking import may_move_on, unnoticed
from doe.ahead.situation import likely_read, refusal
from doe.ahead.to_come import Match, match, whole_day
from doe.constraints import constraints_of, scene_of, visible
from doe.criteria import Criterion, Question
from doe.criteria.task import Task
from doe.curve import stops_paying
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.packed import pack
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from doe.problem.common import at_targets, moved_rows
from doe.problem.information import Regressor
from doe.problem.linearisation import Linearisation, Rows
from doe.problem.nominal import nominal
from doe.problem.pool import Pool, drawn, pool_of
from doe.problem.problem import target_rows

_CANDIDATES = 1000
_MOST_FRESH = 30


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
    found, why = _identified(cell, data, heldout)
    day = whole_day(cell, data, plan, done.left)
    model = _believed(build(cell, day.poses).model, found)
    refuse_idle_effects(cell, model, day.poses)
    values = _values(model, day.poses, found)
    day = _foreseen(day, model.predict(values, day.poses), len(data))
    day = after_the_first_move(model, day)
    arm = _arm(cell, model, found)
    counted = _counted(arm, found)
    at = Linearisation(cell, model, values, counted)
    kept = _kept(day, found)
    rows = at.of(day, kept).per(model.sizes)
    moved = moved_rows(at, day, at.weights(day, kept), rows)
    lacking, beside = _lacking(cell, model, values, arm, found)
    targets, weights = targets_of(cell)
    doubt = unnoticed(cell, model, values, found, targets, weights)
    if not lacking.rms:
        doubt = replace(doubt, at_targets=max(doubt.at_targets, lacking.seen.certain))
    moving = may_move_on(cell, found, targets, weights)
    doubt = replace(doubt, at_targets=float(np.hypot(doubt.at_targets, moving)))
    regressor = Regressor(cell, model, values, np.diag(model.sizes))
    at_markers = any(isinstance(e, Tool) for e in model.effects)
    aims = target_rows(regressor, targets, at_markers)
    behind = _behind(found, lacking)
    share = weights / weights.sum()
    counts = at_points_read(model) if at_markers else at_tip(model)
    predicted = at_targets(model, counts, values, targets)
    forecast = Forecast(model, aims, share, beside, lacking.seen.rms, behind, doubt, predicted)
    criterion = _task(regressor, forecast)
    so_far = np.arange(len(day)) < len(data)
    held = model.beside(values)[1] * model.sizes
    weighs = (_pull(counted, found), _weighing(at, day, kept))
    further = _in_best_order(criterion, rows, moved, so_far, plan, done.left, held, weighs)
    now = told(rows, moved, so_far, held, *weighs)
    steps = tuple(forecast.steps(now, len(data), further))
    sigma = believed_sigma(day, at.weights(day), at.model.readout.channels.lengths) * arm.scale
    result = Enough(model, found, why, sigma, done, steps, goal, lacking, ())
    known_after_all = result.needed is not None or result.beyond_reach
    unasked = not fresh and (goal is None or known_after_all)
    if unasked or any(e.uses for e in model.effects):
        return result
    pool = _pool(regressor, data, missed, seed)
    known = told(rows, moved, None, held, *weighs)
    blocks = Blocks(pool.packed / arm.scale**2, known.root.T @ known.root, regressor.rank)
    chosen = _together(criterion, blocks, fresh, ahead, seed)
    beyond, q = _fresh(pool, blocks, criterion, forecast, at, known, result, fresh, chosen)
    return replace(result, fresh=beyond, fresh_q=q)


def _identified(
    cell: Cell, data: Measurements, heldout: Measurements | None
) -> tuple[Identification | None, str]:
    """The identification of the data so far, or why there is none yet."""
    try:
        return identify(cell, data, heldout=heldout), ""
    except (TooFewPoses, EffectCannotAct) as error:
        return None, str(error)


def _believed(model: Model, found: Identification | None) -> Model:
    """The model with what the readings so far leave to be believed of its type and its sizes."""
    return model if found is None else replace(model, prior=found.model.prior)


def _values(model: Model, poses: Poses, found: Identification | None) -> Array:
    """Where the whole day is linearised: as identified so far, else the nominal model, (p,), SI."""
    values = nominal(model, poses)
    known = {} if found is None else dict(zip(_ids(found.model), found.values, strict=True))
    return np.array([known.get(i, v) for i, v in zip(_ids(model), values, strict=True)])


def _foreseen(day: Measurements, predicted: Array, measured: int) -> Measurements:
    """The day with points where they are expected after those that are measured: noise has a range."""
    return replace(day, readings=np.concatenate([day.readings[:measured], predicted[measured:]]))


def _arm(cell: Cell, model: Model, found: Identification | None) -> Variances:
    """How the arm scatters, as the data so far show it, else as the cell says."""
    shown = None if found is None or found.levels is None else found.levels.variances
    arm = Variances.of_arm(model.robot.dof, cell.repeatability) if shown is None else shown
    if found is None or arm.any:
        return arm
    return replace(arm, scale=found.noise.divisor)


def _counted(arm: Variances, found: Identification | None) -> Variances:
    """How it scatters where readings count: with what was not found, as the identification has it."""
    hidden = None if found is None else found.unnoticed
    return arm if hidden is None else hidden[1].variances


def _pull(arm: Variances, found: Identification | None) -> float:
    """By how much more what is believed weighs beside arms that scatter, as it does in the estimate."""
    if found is None:
        return 1.0
    return found.pull if arm.any else found.pull / found.noise.divisor


def _weighing(at: Linearisation, data: Measurements, kept: Mask | None = None) -> Mixing | None:
    """What the estimate weighs whole poses by: how the arm scatters as the cell says it."""
    arm = Variances.of_arm(at.model.robot.dof, at.cell.repeatability)
    return replace(at, arm=arm).of(data, kept).mixing if arm.any else None


def _lacking(
    cell: Cell, model: Model, values: Array, arm: Variances, found: Identification | None
) -> tuple[Lacking, Array]:
    """What does not average away, over all targets and at each, (targets,), m.

    Where something is lacking, it is as much as poses miss by that the fit was without.
    """
    targets, weights = targets_of(cell)
    known = None if found is None else estimate_of(found)
    rest_of = "instrument" if known is None else known.rest_of
    own, lacks = (
        np.sqrt(scatter_at(model, values, targets, part).mean(axis=-1))
        for part in parted(arm, rest_of)
    )
    rest = Unexplained(0.0, "") if known is None else known.unexplained
    surely = bool(lacks.any()) or rest.rms > 0.0
    trend, an_hour_on = _trends(cell, known, targets)

    def rms(errors: Array) -> float:
        return task_error(errors, weights)[0]

    seen = None if found is None else _unseen(found)
    scatter = rms(np.hypot(own, lacks))
    if seen is not None and (scatter or rest.rms):
        beyond = float(np.sqrt(max(0.0, seen.lacking**2 - scatter**2)))
        rest = max(rest, Unexplained(beyond, seen.source), key=lambda one: one.rms)
    seen = seen or Unseen(0.0, 0.0, 0.0, "")
    lacking = Lacking(
        rms(own), rms(lacks), rest, rms(trend), None if an_hour_on is None else rms(an_hour_on),
        seen, rest_of, surely or seen.unexplained > 0.0, cell.design.targets_after,
    )  # fmt: skip
    return lacking, np.sqrt(own**2 + lacks**2 + rest.rms**2 + trend**2)


def _trends(cell: Cell, known: Estimate | None, targets: Poses) -> tuple[Array, Array | None]:
    """What the trend of the day does when the arm comes to the targets, and an hour later, (m,), m."""
    if known is None:
        return np.zeros(len(targets)), None
    after, targets = cell.design.targets_after or 0.0, replace(targets, start=known.start)
    return known.moved_on(targets, after), known.an_hour_on(targets, after)


def _unseen(found: Identification) -> Unseen | None:
    """What poses show that the fit was without: those held out, else the ends of the day."""
    fit, held = fitted_of(found), found.heldout
    if held is not None and held.data.seen.any():
        return at_held_out(fit, held.data).times(found.footprint)
    ends = at_ends(fit)
    return None if ends is None else ends.times(found.footprint)


def _behind(found: Identification | None, lacking: Lacking) -> float:
    """Degrees of freedom behind what is taken for noise, infinite where it is known.

    Where poses err as a whole it counts them, not points: which variances they show is chosen as well.
    """
    if found is None:
        return np.inf
    told = found.levels is not None and not len(found.levels.free)
    as_a_whole = bool(lacking.rms) and not told
    return freedom(found.noise.dof, found.stays, found.rank, as_a_whole=as_a_whole)


def _ids(model: Model) -> tuple[str, ...]:
    return tuple(p.id for p in model.parameters)


def _kept(day: Measurements, found: Identification | None) -> Mask:
    """Readings that count: all but the outliers among those that are measured, shape (m,)."""
    kept = np.ones(len(day), dtype=bool)
    if found is not None:
        kept[: len(found.fit.outlier)] = ~found.fit.outlier
    return kept


def _task(regressor: Regressor, forecast: Forecast) -> Criterion:
    """The expected error at the targets, for information in plausible sizes."""
    none = np.zeros((0, *regressor.T.shape))
    aims, weights = forecast.rows, forecast.weights
    return Task.of(Question(regressor.model, regressor.T, None, None, lambda: aims, weights, none))


def _in_best_order(
    criterion: Criterion,
    day: Rows,
    moved: Rows,
    so_far: Mask,
    plan: Poses,
    left: IntArray,
    held: Array,
    weighs: tuple[float, Mixing | None],
) -> Iterator[tuple[str, int, Told]]:
    """The poses of which readings are still to come, with all that is told after each."""
    if not len(left):
        return
    poses, of = np.unique(left % len(plan), return_inverse=True)
    number = np.full(len(so_far), -1)
    number[~so_far] = of
    rows = day.independent
    own = [stacked(rows[number == k]) for k in range(len(poses))]
    known = stacked(rows[so_far])
    packed = pack(np.stack([rows.T @ rows for rows in own]))
    blocks = Blocks(packed, known.T @ known + held.T @ held, max(map(len, own)))
    done = so_far.copy()
    for k in best_next(criterion, blocks, len(own)):
        done = done | (number == k)
        yield plan.names[poses[k]], len(of[of == k]), told(day, moved, done, held, *weighs)


def _pool(regressor: Regressor, data: Measurements, missed: Poses | None, seed: int) -> Pool:
    """Candidates beyond the plan."""
    cell = regressor.cell
    chunks = drawn(cell, _CANDIDATES, None, seed)
    pool = pool_of(regressor, constraints_of(cell), None, chunks, _CANDIDATES)
    if missed is None:
        return pool
    pool = pool.where(likely_read(cell.robot, pool.q, data.poses, missed))
    if not len(pool):
        raise CalibError(refusal(missed))
    return pool


def _together(criterion: Criterion, blocks: Blocks, fresh: int, ahead: int, seed: int) -> IntArray:
    """The best of as many candidates as are still to be read, those first that add most."""
    count = min(max(fresh, ahead), len(blocks))
    if count < 2 or not fresh:
        return np.zeros(0, dtype=int)
    beside = open_beside(blocks)
    rules = Allowed(np.zeros(len(blocks), dtype=int), np.zeros(1), np.array([count]), 1)
    relaxed = relax(criterion, beside, rules)
    plan = best_plan(criterion, beside, rules, relaxed, seed=seed, thorough=False).plan
    return plan[best_next(criterion, blocks.take(plan), count)]


def _fresh(
    pool: Pool,
    blocks: Blocks,
    criterion: Criterion,
    forecast: Forecast,
    at: Linearisation,
    known: Told,
    answer: Enough,
    wanted: int,
    chosen: IntArray,
) -> tuple[tuple[Step, ...], Array]:
    """Poses beyond the plan, those that are chosen or each the one that adds most, and their joint
    values, (n, dof).

    So many as are wanted, else until the goal is met or tried enough.
    """
    steps: list[Step] = []
    found: list[Array] = []
    count = answer.steps[-1].readings
    while len(pool) and len(steps) < (wanted or _MOST_FRESH):
        if len(steps) < len(chosen):
            index = chosen[len(steps) : len(steps) + 1]
        else:
            blocks = replace(blocks, fixed=known.root.T @ known.root)
            index = best_next(criterion, blocks, 1)
        found.append(pool.q[index])
        read = _of_one(at, pool.q[index])
        one = at.of(read).per(at.model.sizes)
        also = moved_rows(at, read, at.weights(read), one)
        known = known.beside(told(one, also, weighing=_weighing(at, read)))
        name = f"fresh{len(steps) + 1}"
        *_, step = forecast.steps(known, count, [(name, len(one.whitened), known)])
        count = step.readings
        steps.append(step)
        if not wanted and answer.reaches(step):
            break
    return tuple(steps), np.concatenate(found or [np.zeros((0, at.cell.robot.dof))])


def _of_one(at: Linearisation, q: Array) -> Measurements:
    """The readings of a fresh pose, q of shape (1, dof), with the markers that will be in sight."""
    poses = readings(at.cell, poses_at(q, names=[""]))
    seen = np.tile(visible(scene_of(at.cell, q)), (len(poses), 1))
    return Measurements(
        poses, at.model.predict(at.values, poses), seen, np.full(seen.shape, np.nan)
    )


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
