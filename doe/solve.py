"""From candidates to the plan: weights, whole plan, proof, polish, and the certificate."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from calib.poses import IntArray
from calib.se3 import Array
from doe.allowed import Allowed
from doe.assess import open_parameters
from doe.blocks import Blocks
from doe.branch import Proof, prove
from doe.certify import survivors
from doe.packed import pack
from doe.plan import Certificate
from doe.polish import polish
from doe.pool import Pool, drawn, judge
from doe.problem import Problem
from doe.refusals import CannotIdentify
from doe.relax import Relaxation, relax
from doe.robust import robust_exchange, smallest_left
from doe.search import best_plan

_PROVABLE = 400  # surviving candidates up to which branch and bound is tried
_NODES = 400


@dataclass(frozen=True)
class Effort:
    """What is done beside the search.

    refine : polish the joint angles; fresh : number of fresh candidates for a second bound, 0 for none
    robust : prefer the plan that is best after the loss of any one pose
    curve : also the best plans of other numbers of poses
    seed : int; progress : called with a line for each step
    """

    refine: bool = True
    fresh: int = 0
    robust: bool = False
    curve: bool = False
    seed: int = 0
    progress: Callable[[str], None] = lambda _: None


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

    index : ndarray of int, shape (N,), candidates; value : float
    starts : ndarray, criterion that each start of the search ended at
    relaxed : Relaxation
    """

    index: IntArray
    value: float
    starts: Array
    relaxed: Relaxation


def choose(problem: Problem, pool: Pool, effort: Effort, clock: Clock) -> Chosen:
    """Best weights over the pool and the best whole plan found. Raises CannotIdentify."""
    blocks, rules = problem.blocks(pool), problem.rules(pool.level)
    relaxed = relax(problem.criterion, blocks, rules)
    clock.lap("relaxation")
    effort.progress(f"weighted plan after {relaxed.rounds} rounds, certified to {relaxed.gap:.1e}")
    found = best_plan(problem.criterion, blocks, rules, relaxed, seed=effort.seed)
    clock.lap("exchange")
    _check_regular(problem, blocks.total(found.plan))
    effort.progress(f"whole plan found, at least {found.value / relaxed.bound:.4f} of the best")
    return Chosen(found.plan, found.value, found.starts, relaxed)


def _check_regular(problem: Problem, M: Array) -> None:
    lost = open_parameters(problem, M)
    if not problem.criterion.whole or not lost.any():
        return
    ids = [p.id for p, gone in zip(problem.model.parameters, lost, strict=True) if gone]
    raise CannotIdentify(
        tuple(ids),
        f"{problem.wish.poses} poses cannot determine {', '.join(ids[:4])}{' ..' * (len(ids) > 4)}; "
        "ask for more poses, or take some of them out of [model] effects",
    )


def finish(
    problem: Problem, pool: Pool, chosen: Chosen, effort: Effort, clock: Clock
) -> tuple[Array, Certificate, int]:
    """Prove, harden, polish: joint values (N, dof), certificate, and candidates that survive."""
    criterion, blocks, rules = problem.criterion, problem.blocks(pool), problem.rules(pool.level)
    index, value, relaxed = chosen.index, chosen.value, chosen.relaxed
    live = survivors(relaxed.G, blocks, rules, value)
    proof = Proof(index, value, relaxed.bound, 0)
    if len(live) <= _PROVABLE and _provable(problem, blocks, rules):
        proof = prove(criterion, blocks, rules, index, relaxed.G, most_nodes=_NODES)
        index = proof.plan
        clock.lap("branch and bound")
        said = (
            "proved optimal" if proof.optimal else f"bound down to {proof.value / proof.bound:.4f}"
        )
        effort.progress(f"branch and bound, {proof.nodes} nodes: {said}")
    if effort.robust:
        index = robust_exchange(criterion, blocks, rules, index)
        clock.lap("robust exchange")
    q, M, final = pool.q[index], blocks.total(index), relaxed
    if effort.refine and not effort.robust:
        q, M = polish(problem, q, M, seed=effort.seed)
        pool = pool.joined(_judged(problem, q))
        start = np.concatenate([relaxed.index, np.arange(len(pool) - len(q), len(pool))])
        final = relax(criterion, problem.blocks(pool), problem.rules(pool.level), start=start)
        clock.lap("polish")
    value = float(criterion.value(M))
    fresh = np.nan
    if effort.fresh:
        fresh = fresh_bound(problem, final.G, effort.fresh, effort.seed + 2)
        clock.lap("fresh candidates")
    certificate = Certificate(
        value=value,
        bound=max(final.bound, value),
        weighted=final.value,
        fresh=fresh,
        pool_value=float(criterion.value(blocks.total(index))),
        pool_bound=proof.bound,
        optimal=proof.optimal and not effort.robust,
        nodes=proof.nodes,
        rounds=final.rounds,
        agreement=float(np.median(chosen.starts) / chosen.value),
        left=smallest_left(criterion, M, problem.information(q)),
    )
    return q, certificate, len(live)


def _provable(problem: Problem, blocks: Blocks, rules: Allowed) -> bool:
    """Whether branch and bound applies: a smooth criterion, settled levels, no repeats."""
    smooth = problem.criterion.curvature(
        blocks.fixed + np.eye(len(blocks.fixed)), np.eye(len(blocks.fixed))[None]
    )
    return smooth is not None and not rules.chooses_levels and not rules.repeats


def _judged(problem: Problem, q: Array) -> Pool:
    """Poses that satisfy the constraints, as candidates."""
    part = judge(problem.regressor, (), problem.wish.levels, q)
    return Pool(part.q, part.packed, part.level, part.visible, len(q), {}, {})


def fresh_bound(problem: Problem, G: Array, count: int, seed: int) -> float:
    """No plan of as many other candidates is better: what the pool's coarseness hides."""

    def scored(q: Array) -> tuple[Array, IntArray]:
        part = judge(problem.regressor, problem.constraints, problem.wish.levels, q)
        return part.packed @ pack(G), part.level

    with ThreadPoolExecutor(2) as executor:
        parts = list(executor.map(scored, drawn(problem.cell, count, problem.wish.levels, seed)))
    scores, level = (np.concatenate(column) for column in zip(*parts, strict=True))
    return float((G * problem.fixed).sum()) + problem.rules(level).best(scores)[0]
