"""From candidates to the plan: weights, whole plan, polish, and the certificate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.assess import open_parameters
from doe.candidates import Pool, movable, rounded
from doe.constraints import scene_of
from doe.optimal.function import Selection
from doe.optimal.relax import bounded, relax
from doe.optimal.search import WholePlan, best_plan
from doe.plan import Certificate
from doe.problem import Problem
from doe.request import CannotIdentify

_ROUNDING = 1e-6  # of a value
_EPSILON = 1e-15  # the same for each unit of the condition number of what is inverted
_TRIES, _ROUNDS = 32, 36  # neighbours of each pose in one round
_WIDEST, _NARROWEST = 0.12, 6e-4  # of the joint range, in the first round and in the last


def choose(problem: Problem, pool: Pool, *, thorough: bool = True) -> WholePlan:
    """Best weights over the pool and the best whole plan found. Raises CannotIdentify."""
    posed = problem.posed(pool)
    best = best_plan(posed, relax(posed), seed=problem.request.seed, thorough=thorough)
    if problem.criterion.whole:
        _check_determined(problem, posed.blocks.total(best.plan))
    return _reported(problem, posed, best)


def _reported(problem: Problem, posed: Selection, best: WholePlan) -> WholePlan:
    """A plan with value and bound of the criterion that people read.

    The search goes by one with a little more in it, and a bound of the one is none of the other: at a
    single target it was broken by 0.05 %. The plain gradient bounds the plain criterion at any matrix.
    """
    plain, relaxed = replace(posed, criterion=problem.criterion.plain), best.relaxed
    if plain.criterion is not posed.criterion:
        relaxed = bounded(plain, relaxed)
    return replace(best, value=plain.value(best.plan), relaxed=relaxed)


def _check_determined(problem: Problem, M: Array) -> None:
    """Refuse information that leaves parameters of the model open."""
    lost, request = open_parameters(problem, M), problem.request
    ids = [p.id for p, gone in zip(problem.model.parameters, lost, strict=True) if gone]
    if ids:
        more = "more poses" if request.levels is None else "more levels, more poses"
        raise CannotIdentify(
            tuple(ids),
            f"{request.poses} poses leave {len(ids)} of {len(lost)} parameters open: "
            f"{', '.join(ids[:4])}{' ..' * (len(ids) > 4)}; ask for {more}, or take effects out of "
            "[model] effects",
        )


def certified(
    problem: Problem, pool: Pool, before: WholePlan, final: WholePlan, again: Array
) -> Certificate:
    """What is proved of a plan whose poses ``again`` (m, dof) are visited twice.

    before : the plan before its poses were polished; final : its poses among those of the pool
    """
    posed = replace(problem.posed(pool), criterion=problem.criterion.plain)
    blocks, relaxed, count = posed.blocks, final.relaxed, len(again)
    scores = blocks.scores(relaxed.G)
    best = np.full(count, scores.argmax()) if posed.allowed.repeats else np.argsort(-scores)[:count]
    M = blocks.total(final.plan)
    # A plan that leaves some parameters open is known to few digits: its bound, of no inverse, to more.
    rounding = max(_ROUNDING, _EPSILON * float(np.linalg.cond(M)))
    bound = relaxed.bound + float(scores[best].sum())
    value = float(posed.criterion.value(M + problem.information(again).sum(axis=0)))
    if not posed.allowed.admits(final.plan) or value > bound * (1.0 + rounding):
        raise AssertionError("a plan against its rules, or above its bound: this is a defect")
    return Certificate(
        value=min(value, bound),
        bound=bound,
        weighted=float(posed.criterion.value(relaxed.M + blocks.matrices(best).sum(axis=0))),
        pool_value=before.value,
        pool_bound=before.relaxed.bound,
        rounds=before.relaxed.rounds,
        agreement_of_starts=before.agreement,
    )


def polished(problem: Problem, pool: Pool, chosen: WholePlan) -> tuple[Pool, WholePlan]:
    """The plan with its joint angles moved; its poses join the candidates, so the bound knows them."""
    M = problem.posed(pool).blocks.total(chosen.plan)
    q = _polish(problem, pool.q[chosen.plan], M, seed=problem.request.seed)
    plan = np.arange(len(pool), len(pool) + len(q))
    pool = pool.plus(problem.regressor, problem.request.levels, q)
    posed = problem.posed(pool)
    relaxed = relax(posed, start=np.concatenate([chosen.relaxed.support, plan]))
    return pool, _reported(problem, posed, replace(chosen, plan=plan, relaxed=relaxed))


def _polish(problem: Problem, q: Array, M: Array, *, seed: int) -> Array:
    """Move the poses of a plan inside the constraints, levels kept.

    q : ndarray, shape (N, dof); M : ndarray, shape (p, p), information of the plan
    Returns as many poses; the criterion is never lower than before.
    """
    rng, blocks = np.random.default_rng(seed), problem.information(q)
    value = float(problem.criterion.value(M))
    for width in np.geomspace(_WIDEST, _NARROWEST, _ROUNDS):
        tries, owner = _neighbours(problem, q, width, rng)
        tried, q = problem.information(tries), q.copy()
        for slot in range(len(q)):
            near = np.flatnonzero(owner == slot)
            base = M - blocks[slot]
            values = problem.criterion.value(base + tried[near])
            if len(near) and values.max() > value:
                best = near[values.argmax()]
                value, q[slot], blocks[slot] = float(values.max()), tries[best], tried[best]
                M = base + blocks[slot]
    return q


def _neighbours(
    problem: Problem, q: Array, width: float, rng: np.random.Generator
) -> tuple[Array, IntArray]:
    """Poses near those of a plan (N, dof) that keep the constraints, and which one each is near.

    width : of the steps, by the joints' ranges
    """
    robot, levels = problem.cell.robot, problem.request.levels
    low, high = robot.sample_limits().T
    steps = rng.normal(size=(len(q), _TRIES, robot.dof)) * width * (high - low)
    steps *= movable(problem.cell, levels)
    # Half of the tries move one joint alone: most gains lie along single axes.
    steps[:, : _TRIES // 2] *= np.eye(robot.dof)[
        rng.integers(robot.dof, size=(len(q), _TRIES // 2))
    ]
    tries = rounded(problem.cell, np.clip(q[:, None, :] + steps, low, high).reshape(-1, robot.dof))
    owner = np.repeat(np.arange(len(q)), _TRIES)
    if levels is not None:
        tries[:, levels.joint] = q[owner, levels.joint]
    tries = robot.tied(tries)
    for constraint in problem.constraints:
        if len(tries):
            kept = constraint.allows(scene_of(problem.cell, tries))
            tries, owner = tries[kept], owner[kept]
    return tries, owner
