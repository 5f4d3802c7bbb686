"""The verb: is what was measured enough, what does the rest of the plan bring, and in which order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.build import build, refuse_idle_effects
from calib.cell import Cell
from calib.effects.tool import Tool
from calib.errors import EffectCannotAct, TooFewPoses
from calib.identify import Identification, identify
from calib.identify.identify import whitening
from calib.identify.noise_level import believed_sigma
from calib.model import Model
from calib.observations import Points
from calib.poses import IntArray, Measurements, Poses
from calib.se3 import Array
from calib.targets import targets_of
from calib.threads import one_blas_thread
from doe.blocks import Blocks
from doe.constraints import constraints_of, scene_of, visible
from doe.criteria import Criterion, Question
from doe.criteria.task import Task
from doe.enough.answer import Enough
from doe.enough.forecast import Forecast, Step, best_next, root
from doe.enough.match import match
from doe.enough.session import session
from doe.information import Regressor
from doe.nominal import nominal
from doe.packed import pack
from doe.pool import drawn, pool_of
from doe.problem import target_rows

_CANDIDATES = 500
_MOST_FRESH = 30


@one_blas_thread
def enough(
    cell: Cell,
    data: Measurements,
    plan: Poses | None = None,
    *,
    goal: float | None = None,
    seed: int = 0,
) -> Enough:
    """Say what the data tell, and what the rest of a plan adds, pose by pose in the best order.

    data : the readings so far; poses of the plan among them are found by their joints, or their names
    plan : the plan that is being measured, None for the data alone
    goal : expected RMS error at the targets that is wanted, m
    seed : of the fresh candidates by which poses beyond the plan are judged

    The order is greedy: each pose is the one that lowers the expected error most beside those before
    it. The noise is what the data show; outliers count nothing. Time, temperature and approach of what
    is to come follow the data and the plan's order, whatever the order here.

    Raises CalibError where the whole plan would not do.
    """
    plan = data.poses.take([]) if plan is None else plan
    done = match(cell, plan, data.poses)
    found, why = _identified(cell, data)
    day = session(cell, data, plan, done.left)
    model = build(cell, day.poses).model
    refuse_idle_effects(cell, model, day.poses)
    values = _values(model, day.poses, found)
    factor = 1.0 if found is None else found.noise.factor
    day = _foreseen(day, model.predict(values, day.poses), len(data))
    weights = whitening(cell, model, values, day)
    counted = weights * _kept(day, found)[:, None, None, None]
    _, J = Points(model, day, counted).linearise(values)
    rows = J * model.sizes / factor
    forecast = Forecast(model, values, *targets_of(cell))
    regressor = Regressor(cell, model, values, np.diag(model.sizes))
    criterion = _task(regressor, forecast)
    known, readings = rows[: len(data)].reshape(-1, rows.shape[-1]), len(data)
    further = _in_best_order(criterion, known, rows[len(data) :], plan, done.left)
    steps = tuple(forecast.steps(known, readings, further))
    sigma = believed_sigma(day, weights) * factor
    result = Enough(model, found, why, sigma, done, steps, goal, ())
    if goal is None or result.needed is not None or any(e.uses for e in model.effects):
        return result
    known = np.concatenate([known, rows[len(data) :].reshape(-1, rows.shape[-1])])
    return replace(
        result, fresh=_fresh(regressor, criterion, forecast, known, result, factor, seed)
    )


def _identified(cell: Cell, data: Measurements) -> tuple[Identification | None, str]:
    """The identification of the data so far, or why there is none yet."""
    try:
        return identify(cell, data), ""
    except (TooFewPoses, EffectCannotAct) as error:
        return None, str(error)


def _values(model: Model, poses: Poses, found: Identification | None) -> Array:
    """Where the whole day is linearised: as identified so far, else the nominal model, (p,), SI."""
    values = nominal(model, poses)
    known = {} if found is None else dict(zip(_ids(found.model), found.values, strict=True))
    return np.array([known.get(i, v) for i, v in zip(_ids(model), values, strict=True)])


def _foreseen(day: Measurements, predicted: Array, measured: int) -> Measurements:
    """The day with points where they are expected after those that are measured: noise has a range."""
    return replace(day, points=np.concatenate([day.points[:measured], predicted[measured:]]))


def _ids(model: Model) -> tuple[str, ...]:
    return tuple(p.id for p in model.parameters)


def _kept(day: Measurements, found: Identification | None) -> NDArray[np.bool_]:
    """Readings that count: all but the outliers among those that are measured, shape (m,)."""
    kept = np.ones(len(day), dtype=bool)
    if found is not None:
        kept[: len(found.fit.outlier)] = ~found.fit.outlier
    return kept


def _task(regressor: Regressor, forecast: Forecast) -> Criterion:
    """The expected error at the targets, for information in plausible sizes."""
    model, weights = regressor.model, forecast.weights / forecast.weights.sum()
    at_markers = any(isinstance(effect, Tool) for effect in model.effects)
    p = len(model.parameters)
    return Task.of(
        Question(
            model,
            regressor.T,
            None,
            None,
            lambda: target_rows(regressor, forecast.targets, at_markers),
            weights,
            np.zeros((0, p, p)),
        )
    )


def _in_best_order(
    criterion: Criterion, known: Array, coming: Array, plan: Poses, left: IntArray
) -> Iterator[tuple[str, int, Array]]:
    """The poses of which readings are still to come, with those readings' rows."""
    if not len(left):
        return
    poses, of, counts = np.unique(left % len(plan), return_inverse=True, return_counts=True)
    own = [coming[of == k].reshape(-1, coming.shape[-1]) for k in range(len(poses))]
    packed = pack(np.stack([rows.T @ rows for rows in own]))
    blocks = Blocks(packed, known.T @ known, max(map(len, own)))
    for k in best_next(criterion, blocks, len(own)):
        yield plan.names[poses[k]], int(counts[k]), own[k]


def _fresh(
    regressor: Regressor,
    criterion: Criterion,
    forecast: Forecast,
    known: Array,
    answer: Enough,
    factor: float,
    seed: int,
) -> tuple[Step, ...]:
    """Poses beyond the plan, each the one that adds most, until the goal is met or tried enough."""
    cell = regressor.cell
    steps: list[Step] = []
    chunks = drawn(cell, _CANDIDATES, None, seed)
    pool = pool_of(regressor, constraints_of(cell), None, chunks, _CANDIDATES)
    R, readings = root(known), answer.steps[-1].readings
    while len(pool) and len(steps) < _MOST_FRESH:
        blocks = Blocks(pool.packed / factor**2, R.T @ R, regressor.rank)
        q = pool.q[best_next(criterion, blocks, 1)]
        rows = regressor.rows(q, visible(scene_of(cell, q)))[0] / factor
        *_, step = forecast.steps(
            R, readings, [(f"fresh{len(steps) + 1}", 1 if cell.load is None else 2, rows)]
        )
        R, readings = root(np.concatenate([R, rows])), step.readings
        steps.append(step)
        if answer.reaches(step):
            break
    return tuple(steps)
