"""From candidates to the plan: weights, whole plan, polish, and the certificate."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.assess import assess, open_parameters
from doe.constraints import scene_of
from doe.criteria.determinant import Determinant
from doe.optimal.allowed import Allowed
from doe.optimal.exchange import greedy
from doe.optimal.relax import bounded, relax
from doe.optimal.search import WholePlan, best_plan
from doe.optimal.selection import Selection
from doe.plan import Certificate
from doe.problem import Problem
from doe.problem.pool import Pool, judge, movable, rounded, together
from doe.problem.request import CannotIdentify

_ROUNDING = 1e-6  # of a value
_EPSILON = 1e-15  # the same for each unit of the condition number of what is inverted
_LOOKED_AT = 100  # candidates of each level, at least, by which a number of poses is judged
_TRIES = 24  # neighbours of each pose in one round
_ROUNDS = 30
_WIDEST = 0.12  # of the joint range, shrinking to a two-hundredth of it
_NARROWEST = 6e-4
_TRIED = 300  # candidates of the largest scores, to be visited in place of a pose twice


@dataclass
class Progress:
    """What is told on the way, a line for each step, and the seconds that each part took."""

    tell: Callable[[str], None] = lambda _: None
    laps: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        """Close a part."""
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + now - self.last
        self.last = now


def choose(problem: Problem, pool: Pool, progress: Progress, *, thorough: bool = True) -> WholePlan:
    """Best weights over the pool and the best whole plan found. Raises CannotIdentify."""
    posed = problem.posed(pool)
    relaxed = relax(posed)
    progress.lap("relaxation")
    progress.tell(f"weighted plan after {relaxed.rounds} rounds, certified to {relaxed.gap:.1e}")
    found = best_plan(posed, relaxed, seed=problem.request.seed, thorough=thorough)
    progress.lap("exchange")
    if problem.criterion.whole:
        _check_determined(problem, posed.blocks.total(found.plan))
    chosen = _reported(problem, posed, found)
    progress.tell(
        f"whole plan found, at least {chosen.value / chosen.relaxed.bound:.4f} of the best"
    )
    return chosen


def _reported(problem: Problem, posed: Selection, found: WholePlan) -> WholePlan:
    """A plan with value and bound of the criterion that people read.

    The search goes by one with a little more in it, and a bound of the one is none of the other: at a
    single target it was broken by 0.05 %. The plain gradient bounds the plain criterion at any matrix.
    """
    plain, relaxed = posed.by(problem.criterion.plain), found.relaxed
    if plain.criterion is not posed.criterion:
        relaxed = bounded(plain, relaxed)
    return replace(found, value=plain.value(found.plan), relaxed=relaxed)


def check_count(problem: Problem, pool: Pool) -> None:
    """Refuse at once a number of poses that leaves the model open wherever they stand.

    Judged by the greedy plan for D, which adds directions as fast as they come, over some candidates.
    """
    posed = problem.posed(pool)
    blocks, rules = posed.blocks, posed.allowed
    if not problem.criterion.whole or rules.chooses_levels:
        return
    size = blocks.scores(np.eye(len(blocks.fixed)))
    # Those that tell most, and of the others an even share: one instrument may hide another's.
    ordered = [members[np.argsort(-size[members])] for members in rules.members]
    count = max(_LOOKED_AT, problem.request.poses)  # a plan of these takes each once
    told = [own[:count] for own in ordered]
    told += [own[np.linspace(0, len(own) - 1, count).astype(int)] for own in ordered]
    some = np.unique(np.concatenate(told))
    part = posed.by(Determinant(np.eye(len(blocks.fixed)))).take(some)
    _check_determined(problem, part.blocks.total(greedy(part)))


def _check_determined(problem: Problem, M: Array) -> None:
    """Refuse information that leaves parameters of the model open."""
    lost, request = open_parameters(problem, M), problem.request
    if not lost.any():
        return
    ids = [p.id for p, gone in zip(problem.model.parameters, lost, strict=True) if gone]
    more = "more poses" if request.levels is None else "more levels, more poses"
    raise CannotIdentify(
        tuple(ids),
        f"{request.poses} poses leave {len(ids)} of {len(lost)} parameters open: {', '.join(ids[:4])}"
        f"{' ..' * (len(ids) > 4)}; ask for {more}, or take effects out of [model] effects",
    )


def finish(
    problem: Problem, pool: Pool, chosen: WholePlan, progress: Progress
) -> tuple[Pool, WholePlan, Certificate]:
    """Polish: the plan before it is put into the order of a day, and what is proved of it.

    Returns the candidates as well, the plan's own poses among them.
    """
    before = chosen
    if problem.request.refine:
        pool, chosen = _polished(problem, pool, chosen)
        progress.lap("polish")
    posed = problem.posed(pool)
    value, bound = chosen.value, chosen.relaxed.bound
    # A plan that leaves some parameters open is known to few digits: its bound, of no inverse, to more.
    rounding = max(_ROUNDING, _EPSILON * float(np.linalg.cond(posed.blocks.total(chosen.plan))))
    if not posed.allowed.admits(chosen.plan) or value > bound * (1.0 + rounding):
        raise AssertionError("a plan against its rules, or above its bound: this is a defect")
    certificate = Certificate(
        value=min(value, bound),
        bound=bound,
        weighted=chosen.relaxed.value,
        pool_value=before.value,
        pool_bound=before.relaxed.bound,
        rounds=before.relaxed.rounds,
        agreement_of_starts=before.agreement,
    )
    return pool, chosen, certificate


def _polished(problem: Problem, pool: Pool, chosen: WholePlan) -> tuple[Pool, WholePlan]:
    """The plan with its joint angles moved."""
    M, own = problem.blocks(pool).total(chosen.plan), pool.q[chosen.plan]
    return _with_own(problem, pool, chosen, polish(problem, own, M, seed=problem.request.seed))


def _with_own(problem: Problem, pool: Pool, chosen: WholePlan, q: Array) -> tuple[Pool, WholePlan]:
    """The plan of poses (N, dof), which join the candidates, so that the bound knows them."""
    plan = np.arange(len(pool), len(pool) + len(q))
    pool = together([pool, judge(problem.regressor, (), problem.request.levels, q)])
    posed = problem.posed(pool)
    relaxed = relax(posed, start=np.concatenate([chosen.relaxed.index, plan]))
    return pool, _reported(problem, posed, replace(chosen, plan=plan, relaxed=relaxed))


def polish(problem: Problem, q: Array, M: Array, *, seed: int) -> Array:
    """Move the poses of a plan inside the constraints, levels kept.

    q : ndarray, shape (N, dof); M : ndarray, shape (p, p), information of the plan
    Returns as many poses; the criterion is never lower than before.
    """
    rng = np.random.default_rng(seed)
    blocks = problem.information(q)
    value = float(problem.criterion.value(M))
    for width in np.geomspace(_WIDEST, _NARROWEST, _ROUNDS):
        kept, found, owner = _feasible(problem, *_neighbours(problem, q, width, rng))
        taken = np.full(len(q), -1)
        for slot in range(len(q)):
            own = np.flatnonzero(owner == slot)
            if not len(own):
                continue
            base = M - blocks[slot]
            values = problem.criterion.value(base + found[own])
            best = int(values.argmax())
            if values[best] > value:
                value, taken[slot] = float(values[best]), own[best]
                blocks[slot] = found[own[best]]
                M = base + blocks[slot]
        source = np.where(taken < 0, np.arange(len(q)), len(q) + taken)
        q = np.concatenate([q, kept])[source]
    return q


def _neighbours(
    problem: Problem, q: Array, width: float, rng: np.random.Generator
) -> tuple[Array, IntArray]:
    """Poses near those of a plan (N, dof), some of each, and which one each of them is near.

    width : of the steps, by the joints' ranges
    """
    robot, levels = problem.cell.robot, problem.request.levels
    low, high = robot.sample_limits().T
    free, each = movable(problem.cell, levels), (len(q), _TRIES)
    steps = rng.normal(size=(*each, robot.dof)) * width * (high - low) * free
    # Half of the tries move one joint alone: most gains lie along single axes.
    lone = np.eye(robot.dof)[rng.integers(robot.dof, size=(len(q), _TRIES // 2))]
    steps[:, : _TRIES // 2] *= lone
    tries = rounded(problem.cell, np.clip(q[:, None, :] + steps, low, high).reshape(-1, robot.dof))
    owner = np.repeat(np.arange(len(q)), _TRIES)
    if levels is not None:
        tries[:, levels.joint] = q[owner, levels.joint]
    return robot.tied(tries), owner


def _feasible(problem: Problem, tries: Array, owner: IntArray) -> tuple[Array, Array, IntArray]:
    """Tries that satisfy the constraints, their information, and the pose each belongs to."""
    for constraint in problem.constraints:
        if len(tries):
            kept = constraint.allows(scene_of(problem.cell, tries))
            tries, owner = tries[kept], owner[kept]
    none = np.zeros((0, *problem.fixed.shape))
    return tries, problem.information(tries) if len(tries) else none, owner


def with_second_visits(
    problem: Problem, pool: Pool, found: WholePlan, before: Certificate, more: Array
) -> Certificate:
    """The certificate of the plan with second visits of some of its poses (m, dof)."""
    plain, relaxed = problem.criterion.plain, found.relaxed
    blocks, again = problem.blocks(pool), problem.information(more)
    scores = blocks.scores(relaxed.G)
    best = problem.rules(pool.level).again(scores, len(more))
    own = np.concatenate([blocks.matrices(found.plan), again])
    M = blocks.fixed + own.sum(axis=0)
    return replace(
        before,
        value=float(plain.value(M)),
        bound=before.bound + float(scores[best].sum()),
        weighted=float(plain.value(relaxed.M + blocks.matrices(best).sum(axis=0))),
    )


def new_poses_instead(problem: Problem, pool: Pool, chosen: IntArray, count: int) -> float:
    """Task RMS [m] with so many more poses in place of second visits, the chosen (N,) kept.

    The poses that add most to the problem's criterion, one after the other; NaN where there are none.
    """
    blocks = problem.blocks(pool)
    scores = blocks.scores(problem.criterion.gradient(blocks.total(chosen)))
    others = np.setdiff1d(np.arange(len(scores)), chosen)
    some: IntArray = others[np.argsort(-scores[others])[:_TRIED]]
    if len(some) < count:
        return np.nan
    beside = replace(blocks.take(some), fixed=blocks.total(chosen))
    any_of = Allowed.any_of(len(some), count)
    more = some[greedy(Selection(problem.criterion, beside, any_of))]
    return assess(problem, pool.q[np.concatenate([chosen, more])]).task_rms
