"""From candidates to the plan: weights, whole plan, proof, polish, and the certificate."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from doe.assess import open_parameters
from doe.criteria import Criterion
from doe.criteria.determinant import Determinant
from doe.optimal.allowed import Allowed, survivors
from doe.optimal.blocks import Blocks, pack
from doe.optimal.branch import SHORT_WORK, Proof, provable, prove
from doe.optimal.exchange import greedy, robust_exchange, smallest_left
from doe.optimal.relax import Relaxation, bounded, relax
from doe.optimal.search import best_plan
from doe.plan import Certificate, Landscape
from doe.polish import polish
from doe.problem import Problem
from doe.problem.pool import Pool, drawn, judge
from doe.problem.refusals import CannotIdentify

_LONG_WORK = 1e11  # multiplications of a branch and bound of minutes
_NODES_TOLD = 200  # nodes between two lines on the way
_ROUNDING = 1e-6
_SHOWN = 20_000  # candidates of the landscape
_LOOKED_AT = 100  # candidates of each level by which a number of poses is judged


@dataclass(frozen=True)
class Effort:
    """What is done beside the search.

    refine : polish the joint angles; fresh : number of fresh candidates for a second bound, 0 for none
    robust : prefer the plan that is best after the loss of any one pose
    prove : go on with branch and bound for minutes
    curve : also the best plans of other numbers of poses
    reference_every : poses between two readings of a reference pose, 0 for none
    reapproaches : poses that are visited again, 0 for none
    seed : int; progress : called with a line for each step
    asked : whether second visits were asked for, else they are a default
    """

    refine: bool = True
    fresh: int = 0
    robust: bool = False
    prove: bool = False
    curve: bool = False
    reference_every: int = 0
    reapproaches: int = 0
    seed: int = 0
    progress: Callable[[str], None] = lambda _: None
    asked: bool = True


@dataclass
class Clock:
    """Seconds by part."""

    laps: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        """Close a part."""
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + now - self.last
        self.last = now


@dataclass(frozen=True, eq=False)
class Chosen:
    """A whole plan of candidates with the weights that bound it.

    index : ndarray of int, shape (N,), candidates; value : float, the plain criterion
    agreement : float, median of what the starts of the search ended at, over the best plan
    relaxed : Relaxation, its value and bound those of the plain criterion
    """

    index: IntArray
    value: float
    agreement: float
    relaxed: Relaxation


@dataclass(frozen=True, eq=False)
class Finished:
    """The plan before it is put into the order of a day.

    certificate : Certificate; landscape : Landscape
    live : int, candidates that a better plan could still contain
    pool : Pool, with the plan's own poses; plan : ndarray of int, shape (N,), its candidates
    relaxed : Relaxation, at which the bound was found
    """

    certificate: Certificate
    landscape: Landscape
    live: int
    pool: Pool
    plan: IntArray
    relaxed: Relaxation

    @property
    def q(self) -> Array:
        """Joint values of the plan, shape (N, dof), rad or m."""
        return self.pool.q[self.plan]


def choose(
    problem: Problem, pool: Pool, effort: Effort, clock: Clock, *, thorough: bool = True
) -> Chosen:
    """Best weights over the pool and the best whole plan found. Raises CannotIdentify."""
    blocks, rules = problem.blocks(pool), problem.rules(pool.level)
    relaxed = relax(problem.criterion, blocks, rules)
    clock.lap("relaxation")
    effort.progress(f"weighted plan after {relaxed.rounds} rounds, certified to {relaxed.gap:.1e}")
    found = best_plan(
        problem.criterion, blocks, rules, relaxed, seed=effort.seed, thorough=thorough
    )
    clock.lap("exchange")
    _check_regular(problem, blocks.total(found.plan))
    agreement = float(np.median(found.starts) / found.value)
    chosen = _reported(problem, blocks, rules, found.plan, agreement, relaxed)
    effort.progress(
        f"whole plan found, at least {chosen.value / chosen.relaxed.bound:.4f} of the best"
    )
    return chosen


def _reported(
    problem: Problem,
    blocks: Blocks,
    rules: Allowed,
    plan: IntArray,
    agreement: float,
    relaxed: Relaxation,
) -> Chosen:
    """A plan with value and bound of the criterion that people read.

    The search goes by one with a little more in it, and a bound of the one is none of the other: at a
    single target it was broken by 0.05 %. The plain gradient bounds the plain criterion at any matrix.
    """
    plain = problem.criterion.plain
    if plain is not problem.criterion:
        relaxed = bounded(plain, blocks, rules, relaxed)
    return Chosen(plan, float(plain.value(blocks.total(plan))), agreement, relaxed)


def check_count(problem: Problem, pool: Pool) -> None:
    """Refuse at once a number of poses that leaves the model open wherever they stand.

    Judged by the greedy plan for D, which adds directions as fast as they come, over some candidates.
    """
    blocks, rules = problem.blocks(pool), problem.rules(pool.level)
    if not problem.criterion.whole or rules.chooses_levels:
        return
    size = blocks.scores(np.eye(len(blocks.fixed)))
    # Those that tell most, and of the others an even share: one instrument may hide another's.
    ordered = [members[np.argsort(-size[members])] for members in rules.members]
    told = [own[:_LOOKED_AT] for own in ordered]
    told += [own[np.linspace(0, len(own) - 1, _LOOKED_AT).astype(int)] for own in ordered]
    some = np.unique(np.concatenate(told))
    part, rules = blocks.take(some), rules.take(some)
    plan = greedy(Determinant(np.eye(len(blocks.fixed))), part, rules)
    lost = open_parameters(problem, part.total(plan))
    if lost.any():
        _refuse(problem, lost)


def _check_regular(problem: Problem, M: Array) -> None:
    lost = open_parameters(problem, M)
    if problem.criterion.whole and lost.any():
        _refuse(problem, lost)


def _refuse(problem: Problem, lost: Mask) -> None:
    ids = [p.id for p, gone in zip(problem.model.parameters, lost, strict=True) if gone]
    request = problem.request
    more = "more poses" if request.levels is None else "more levels, more poses"
    raise CannotIdentify(
        tuple(ids),
        f"{request.poses} poses leave {len(ids)} of {len(lost)} parameters open: {', '.join(ids[:4])}"
        f"{' ..' * (len(ids) > 4)}; ask for {more}, or take effects out of [model] effects",
    )


def finish(problem: Problem, pool: Pool, chosen: Chosen, effort: Effort, clock: Clock) -> Finished:
    """Harden, polish, prove."""
    criterion, before = problem.criterion, chosen
    if effort.robust:
        blocks, rules = problem.blocks(pool), problem.rules(pool.level)
        index = robust_exchange(criterion, blocks, rules, chosen.index)
        value = float(criterion.plain.value(blocks.total(index)))
        chosen = replace(chosen, index=index, value=value)
        clock.lap("robust exchange")
    elif effort.refine:
        pool, chosen = _polished(problem, pool, chosen, effort)
        clock.lap("polish")
    blocks, rules = problem.blocks(pool), problem.rules(pool.level)
    live = survivors(chosen.relaxed.G, blocks, rules, chosen.value)
    plain = criterion.plain
    proof = Proof(chosen.index, chosen.value, chosen.relaxed.bound, 0)
    # What branch and bound proves holds for poses that are visited once.
    if provable(criterion, rules) and not (effort.robust or effort.reapproaches):
        proof = _proved(criterion, blocks, rules, chosen, effort, proof)
        clock.lap("branch and bound")
        effort.progress(_told(proof))
    fresh = np.nan
    if effort.fresh:
        fresh = fresh_bound(problem, chosen.relaxed.G, effort)
        clock.lap("fresh candidates")
    if not rules.admits(proof.plan) or proof.value > proof.bound * (1.0 + _ROUNDING):
        raise AssertionError("a plan against its rules, or above its bound: this is a defect")
    certificate = Certificate(
        value=proof.value,
        bound=proof.bound,
        weighted=chosen.relaxed.value,
        fresh=fresh,
        pool_value=before.value,
        pool_bound=before.relaxed.bound,
        optimal=proof.nodes > 0 and proof.optimal,
        nodes=proof.nodes,
        rounds=before.relaxed.rounds,
        agreement=before.agreement,
        left=smallest_left(plain, blocks.total(proof.plan), blocks.matrices(proof.plan)),
    )
    view = _landscape(pool, rules, blocks.scores(chosen.relaxed.G), proof.plan)
    return Finished(certificate, view, len(live), pool, proof.plan, chosen.relaxed)


def _landscape(pool: Pool, rules: Allowed, scores: Array, plan: IntArray) -> Landscape:
    share = scores / rules.thresholds(scores)[rules.group]
    shown = np.union1d(np.argsort(-share, kind="stable")[:_SHOWN], plan)
    return Landscape(pool.q[shown], share[shown], np.isin(shown, plan))


def _polished(problem: Problem, pool: Pool, chosen: Chosen, effort: Effort) -> tuple[Pool, Chosen]:
    """The plan with its joint angles moved; its poses join the candidates, so the bound knows them."""
    blocks = problem.blocks(pool)
    q = polish(problem, pool.q[chosen.index], blocks.total(chosen.index), seed=effort.seed)
    index = np.arange(len(pool), len(pool) + len(q))
    pool = pool.joined(judge(problem.regressor, (), problem.request.levels, q))
    blocks, start = problem.blocks(pool), np.concatenate([chosen.relaxed.index, index])
    relaxed = relax(problem.criterion, blocks, problem.rules(pool.level), start=start)
    rules = problem.rules(pool.level)
    return pool, _reported(problem, blocks, rules, index, chosen.agreement, relaxed)


def _proved(
    criterion: Criterion,
    blocks: Blocks,
    rules: Allowed,
    chosen: Chosen,
    effort: Effort,
    start: Proof,
) -> Proof:
    """The best plan that branch and bound finds, from the one in hand."""

    def told(proof: Proof) -> None:
        if effort.prove and proof.nodes % _NODES_TOLD == 0:
            effort.progress(_told(proof))

    work = _LONG_WORK if effort.prove else SHORT_WORK
    found = prove(
        criterion.plain, blocks, rules, chosen.index, chosen.relaxed.G, most_work=work, told=told
    )
    return _settled(criterion, blocks, found, start)


def _told(proof: Proof) -> str:
    return f"branch and bound: {proof.value / proof.bound:.4f} after {proof.nodes} nodes"


def _settled(criterion: Criterion, blocks: Blocks, proof: Proof, before: Proof) -> Proof:
    """Bound of branch and bound, with its plan where that is better for what the search goes by too."""
    ends = criterion.value(np.array([blocks.total(p.plan) for p in (before, proof)]))
    if ends[1] >= ends[0]:
        return proof
    return replace(before, bound=proof.bound, nodes=proof.nodes)


def fresh_bound(problem: Problem, G: Array, effort: Effort) -> float:
    """No plan of as many other candidates is better: what the pool's coarseness hides."""
    levels = problem.request.levels

    def scored(q: Array) -> tuple[Array, IntArray]:
        part = judge(problem.regressor, problem.constraints, levels, q)
        return part.packed @ pack(G), part.level

    with ThreadPoolExecutor(2) as executor:
        chunks = drawn(problem.cell, effort.fresh, levels, effort.seed + 2)
        parts = list(executor.map(scored, chunks))
    scores, level = (np.concatenate(column) for column in zip(*parts, strict=True))
    rules, own = problem.rules(level), float((G * problem.fixed).sum())
    again = scores[rules.again(scores, effort.reapproaches)].sum()
    return own + rules.best(scores)[0] + float(again)
