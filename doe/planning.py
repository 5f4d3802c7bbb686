"""The verb: choose the poses of a cell and prove how good they are."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import AskedLevels
from calib.poses import Measurements, Poses
from calib.threads import one_blas_thread
from doe.assess import assess
from doe.curve import accuracy_curve
from doe.levels import AngleLevels, steer_the_model, with_even_knots
from doe.notes import granted_by, notes_of
from doe.order import Reapproaches, day_of, quickest_order, with_reapproaches
from doe.plan import Candidates, Design, Rival, named
from doe.problem import Problem, problem_of
from doe.request import CANDIDATES, CannotIdentify, Request, request_of
from doe.solve import certified, choose, polished


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
    criterion : "task", "task-worst", "D", "Ds", "A", "c", "E", "G" or one of an installed package
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
    (reapproaches). Where it is silent and that is not known, these are a tenth of ``poses``.

    Raises CalibError where no such plan can be: the text says why and what would help.
    """
    asked = request_of(
        cell, poses=poses, criterion=criterion, levels=levels, candidates=candidates,
        extend=extend, discriminate=discriminate, of=of, curve=curve, seed=seed,
    )  # fmt: skip
    return planned(cell, asked, against or {})


@one_blas_thread
def planned(cell: Cell, request: Request, against: Mapping[str, Poses]) -> Design:
    """The plan of a request; without second visits that nobody asked for where they cost too much."""
    try:
        return _planned(cell, request, against)
    except CannotIdentify:
        if request.asked or not request.reapproaches:
            raise
        poses = request.poses + request.reapproaches
        return _planned(cell, replace(request, poses=poses, reapproaches=0), against)


def _planned(cell: Cell, request: Request, against: Mapping[str, Poses]) -> Design:
    clock = _Clock()
    if steer_the_model(cell, request.levels):
        request = replace(request, levels=_levels(cell, request))
        clock.lap("levels")
    problem = problem_of(cell, request)
    offered = pool = problem.candidates()
    clock.lap("pool")
    chosen = final = choose(problem, pool)
    clock.lap("exchange")
    if request.polish and isinstance(request.candidates, int):
        pool, final = polished(problem, pool, chosen)
        clock.lap("polish")
    poses, again, second = _visited(problem, pool.q[final.plan])
    certificate = certified(problem, pool, chosen, final, second)
    left = problem.posed(pool).survivors(final.relaxed.G, final.value)
    result = Design(
        problem=problem,
        poses=poses,
        levels=_settled(problem, poses.q),
        assessment=assess(problem, poses.q),
        certificate=certificate,
        candidates=Candidates(offered.drawn, len(offered), offered.removed, len(left)),
        rivals={
            name: _judged(problem, plan.q, certificate.bound) for name, plan in against.items()
        },
        curve=accuracy_curve(problem, offered) if request.curve else (),
        reapproaches=again,
        day=day_of(cell, poses),
    )
    clock.lap("judgement")
    return replace(result, notes=notes_of(result), granted=granted_by(result), seconds=clock.laps)


def _levels(cell: Cell, request: Request) -> AngleLevels | None:
    """Levels that are best for a model with even knots: the model's own will follow them."""
    levels = request.levels
    if levels is None:
        return None
    problem = problem_of(with_even_knots(cell, levels), request)
    pool = problem.candidates()
    chosen = choose(problem, pool)
    used = np.unique(pool.q[chosen.plan, levels.joint])
    return levels.only(used, chosen.value / chosen.relaxed.bound)


def _settled(problem: Problem, q: Array) -> AngleLevels | None:
    """The levels at which poses (m, dof) stand."""
    levels = problem.request.levels
    if levels is None or levels.chosen:
        return levels
    return levels.only(np.unique(q[:, levels.joint]))


def _visited(problem: Problem, q: Array) -> tuple[Poses, Reapproaches | None, Array]:
    """The poses in the order of a day, which of them are read again, and these (k, dof)."""
    again: Reapproaches | None = None
    poses = named(q[quickest_order(problem.cell, q)])
    if problem.request.reapproaches:
        poses, again = with_reapproaches(problem, poses, problem.request.reapproaches)
    second = [again is not None and name in again.again for name in poses.names]
    order = np.arange(float(len(poses)))
    return replace(poses, order=order), again, poses.q[np.array(second, dtype=bool)]


def _judged(problem: Problem, q: Array, bound: float) -> Rival:
    """A plan (m, dof) beside the result."""
    M = problem.fixed + problem.information(q).sum(axis=0)
    return Rival(assess(problem, q), float(problem.criterion.plain.value(M)) / bound, q)


@dataclass
class _Clock:
    """The seconds that each part took."""

    laps: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self.last = now - self.last, now
