"""The verb: choose the poses of a cell and prove how good they are.

Candidates are drawn and judged, weighed, and the best whole plan of them is searched; its angles are
polished, it is put in the order of a day, and the certificate is recomputed for what came out.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.planned import AskedLevels
from calib.errors import CalibError
from calib.files.tables import load_plan
from calib.poses import Measurements, Poses
from calib.threads import one_blas_thread
from doe.candidates import movable, rounded
from doe.constraints import scene_of
from doe.levels import AngleLevels, levels_of, parse_levels, with_even_knots
from doe.notes import granted_by, notes_of
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import pack
from doe.optimal.function import Selection
from doe.optimal.relax import GAP, bounded, relax
from doe.optimal.search import WholePlan, best_plan, exchange
from doe.order import Reapproaches, day_of, quickest_order, with_reapproaches
from doe.plan import Certificate, CurveStep, Design, Rival, assess, named, open_parameters
from doe.problem import Problem, problem_of
from doe.request import CANDIDATES, CannotIdentify, Request, asked_count, asked_criterion, measured

_ROUNDING = 1e-6  # of a value
_EPSILON = 1e-15  # the same for each unit of the condition number of what is inverted
_ROUGH = 5e-3  # gap of weights that only guide a search: the bound is found anew after the polish
_TRIES, _ROUNDS = 32, 16  # neighbours of each pose in one round
_WIDEST, _NARROWEST = 0.12, 6e-4  # of the joint range, in the first round and in the last
_STEPS = 8  # of a curve
_LEVELS_FIRST = (
    "The levels were chosen first, for a model with even knots; the efficiency is for the levels as "
    "chosen."
)


def design(
    cell: Cell,
    *,
    poses: int | None = None,
    criterion: str = "task",
    levels: Mapping[str, AskedLevels] | str | None = None,
    candidates: int | str | Path | Poses = CANDIDATES,
    extend: str | Path | Poses | Measurements | None = None,
    discriminate: tuple[str, str] | None = None,
    of: Iterable[str] = (),
    against: Mapping[str, Poses] | None = None,
    curve: bool = False,
    seed: int = 0,
) -> Design:
    """Choose poses that make a criterion best, with a certificate.

    poses : how many to choose; the cell's [design] or the levels say it otherwise
    criterion : "task", "D", "Ds", "A", "c", "E", "G" or one of an installed package
    levels : by joint, or in short "A2=5x3", "A2=-140,-57,-10x3"; those of the cell's [design] otherwise
    candidates : number of Sobol candidates, whose angles are polished after the choice, or a table of
        candidates in the format of a plan, which are left as they are
    extend : a plan that is measured in any case, or what was measured; ``poses`` come on top of it
    discriminate : two effects ``effect:where`` that the plan is to tell apart, instead of a criterion
    of : effects or parameters that matter, for Ds, A, E and c (``NAME=FACTOR`` for a combination)
    against : plans to judge beside the result, by name
    curve : also the best plans of fewer and of more poses

    The cell's [design] says whether a candidate may be used more than once (repeats), and how many of
    the poses are visited again, over the day and from the other side, to show the arm's repeatability
    (reapproaches).

    Raises CalibError where no such plan can be: the text says why and what would help.
    """
    source = load_plan(cell, candidates) if isinstance(candidates, str | Path) else candidates
    if isinstance(source, int) and source < 1:
        raise CalibError(f"{source} candidates are too few; ask for a thousand or more")
    at = levels_of(cell, parse_levels(cell, levels) if isinstance(levels, str) else levels, poses)
    request = Request(
        poses=asked_count(cell, poses, at),
        criterion=asked_criterion(criterion, discriminate, tuple(of)),
        levels=at,
        of=tuple(of),
        rivals=discriminate,
        fixed=None if extend is None else measured(cell, extend),
        candidates=source,
        seed=seed,
    )
    return planned(cell, request, against or {}, curve=curve)


@one_blas_thread
def planned(
    cell: Cell, request: Request, against: Mapping[str, Poses], *, curve: bool = False
) -> Design:
    """The plan of a request."""
    begun, levels, early = time.perf_counter(), request.levels, tuple[str, ...]()
    if levels is not None and (even := with_even_knots(cell, levels)) is not None:
        request, early = _settled(even, request, levels), (_LEVELS_FIRST,)
    problem = problem_of(cell, request)
    offered, drawn = problem.posed(), isinstance(request.candidates, int)
    chosen = choose(problem, offered, gap=_ROUGH if drawn else GAP)
    posed, q = offered, problem.pool.q[chosen.plan]
    if drawn:
        posed, chosen, q = _polished(problem, offered, chosen, q)
    poses, again, second = _visited(problem, q)
    certificate = _certified(problem, posed, chosen, second)
    if levels is not None:
        levels = levels.only(np.unique(q[:, levels.joint]))
    result = Design(
        problem=problem,
        poses=poses,
        levels=levels,
        assessment=assess(problem, poses.q),
        certificate=certificate,
        rivals={n: _judged(problem, plan.q, certificate.bound) for n, plan in against.items()},
        curve=_accuracy_curve(problem, offered) if curve else (),
        reapproaches=again,
        duration=day_of(cell, poses),
    )
    notes, seconds = (*early, *notes_of(result)), time.perf_counter() - begun
    return replace(result, notes=notes, granted=granted_by(result), seconds=seconds)


def _settled(cell: Cell, request: Request, levels: AngleLevels) -> Request:
    """The request at levels that are best for a cell with even knots: its own will follow them."""
    problem = problem_of(cell, request)
    best = choose(problem, problem.posed(), thorough=False, gap=_ROUGH)
    return replace(request, levels=levels.only(np.unique(problem.pool.q[best.plan, levels.joint])))


def _visited(problem: Problem, q: Array) -> tuple[Poses, Reapproaches | None, Array]:
    """The poses in the order of a day, which of them are read again, and these (k, dof)."""
    poses, again = named(q[quickest_order(problem.cell, q)]), None
    if count := problem.cell.design.reapproaches:
        poses, again = with_reapproaches(problem, poses, count)
    second = np.array([again is not None and name in again.again for name in poses.names])
    return replace(poses, order=np.arange(float(len(poses)))), again, poses.q[second]


def _judged(problem: Problem, q: Array, bound: float) -> Rival:
    """A plan (m, dof) beside the result."""
    M = problem.fixed + problem.information(q).sum(axis=0)
    efficiency = float(problem.criterion.plain.value(M)) / bound
    return Rival(len(q), assess(problem, q), efficiency)


def choose(
    problem: Problem, posed: Selection, *, thorough: bool = True, gap: float = GAP
) -> WholePlan:
    """Best weights, to a gap, and the best whole plan. Raises CannotIdentify."""
    request = problem.request
    best = best_plan(posed, relax(posed, gap=gap), seed=request.seed, thorough=thorough)
    lost = open_parameters(problem, posed.blocks.total(best.plan))
    if problem.criterion.whole and not request.of and lost.any():
        ids = [p.id for p, gone in zip(problem.model.parameters, lost, strict=True) if gone]
        more = "more poses" if request.levels is None else "more levels, more poses"
        raise CannotIdentify(
            tuple(ids),
            f"{request.poses} poses leave {len(ids)} of {len(lost)} parameters open: "
            f"{', '.join(ids[:4])}{' ..' * (len(ids) > 4)}; ask for {more}, or take effects out of "
            "[model] effects",
        )
    return best


def _certified(problem: Problem, posed: Selection, found: WholePlan, again: Array) -> Certificate:
    """What is proved of a plan whose poses ``again`` (m, dof) are visited twice."""
    plain, blocks, relaxed = problem.criterion.plain, posed.blocks, found.relaxed
    # The search goes by a criterion with a little more in it. A bound of the one is none of the other:
    # at a single target it was broken by 0.05 %.
    if plain is not posed.criterion:
        relaxed = bounded(replace(posed, criterion=plain), relaxed)
    scores, count = blocks.scores(relaxed.G), len(again)
    best = np.full(count, scores.argmax()) if posed.allowed.repeats else np.argsort(-scores)[:count]
    M = blocks.total(found.plan)
    # A plan that leaves some parameters open is known to few digits: its bound, of no inverse, to more.
    rounding = max(_ROUNDING, _EPSILON * float(np.linalg.cond(M)))
    bound = relaxed.bound + float(scores[best].sum())
    value = float(plain.value(M + problem.information(again).sum(axis=0)))
    if not posed.allowed.admits(found.plan) or value > bound * (1.0 + rounding):
        raise AssertionError("a plan against its rules, or above its bound: this is a defect")
    return Certificate(min(value, bound), bound)


def _polished(
    problem: Problem, posed: Selection, chosen: WholePlan, q: Array
) -> tuple[Selection, WholePlan, Array]:
    """The plan with its joint angles q (N, dof) moved, and these: candidates that the bound knows."""
    q, group, plan = _polish(problem, q), posed.allowed.group, len(posed) + np.arange(len(q))
    packed = np.concatenate([posed.blocks.packed, pack(problem.information(q))])
    allowed = replace(posed.allowed, group=np.concatenate([group, group[chosen.plan]]))
    posed = replace(posed, blocks=replace(posed.blocks, packed=packed), allowed=allowed)
    relaxed = relax(posed, start=np.concatenate([chosen.relaxed.support, plan]))
    return posed, replace(chosen, plan=plan, relaxed=relaxed), q


def _polish(problem: Problem, q: Array) -> Array:
    """The poses (N, dof) of a plan exchanged for neighbours inside the constraints, levels kept.

    The criterion is never lower than before.
    """
    rng, own = np.random.default_rng(problem.request.seed), np.arange(len(q))
    for width in np.geomspace(_WIDEST, _NARROWEST, _ROUNDS):
        tries, owner = _neighbours(problem, q, width, rng)
        q = np.concatenate([q, tries])
        rules = Allowed(np.append(own, owner), own.astype(float), np.ones(len(own), int), len(own))
        plan, _ = exchange(Selection(problem.criterion, problem.blocks(q), rules), own)
        q = q[plan]
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


def _accuracy_curve(problem: Problem, posed: Selection) -> tuple[CurveStep, ...]:
    """Plans of the same candidates with fewer and with more poses, up to twice as many."""
    steps = []
    for request in _sizes(problem):
        with suppress(CannotIdentify):
            sized = replace(problem, request=request)
            rules = sized.rules(problem.pool.level)
            best = choose(sized, replace(posed, allowed=rules), thorough=False)
            judged = assess(sized, problem.pool.q[best.plan])
            proved = min(1.0, best.value / best.relaxed.bound)
            steps.append(CurveStep(request.poses, judged.value, judged.task_rms, proved))
    return tuple(steps)


def _sizes(problem: Problem) -> Iterator[Request]:
    request = problem.request
    if request.levels is not None:
        for count in range(1, 2 * request.levels.per_level + 1):
            levels = replace(request.levels, per_level=count)
            yield replace(request, levels=levels, poses=levels.poses)
        return
    least = -(-len(problem.model.parameters) // int(problem.model.readout.channels.rows.sum()))
    sizes = np.geomspace(max(least, 2), 2 * request.poses, _STEPS).round().astype(int)
    for poses in np.union1d(sizes, request.poses).tolist():
        yield replace(request, poses=poses)
