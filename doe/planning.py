"""The verb: choose the poses of a cell and prove how good they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.cell import Cell
from calib.cell.planned import AskedLevels
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.errors import CalibError, InputError
from calib.files.tables import holds_points, load_measurements, load_plan
from calib.model.build import parse_effect
from calib.poses import Measurements, Poses
from calib.threads import one_blas_thread
from doe.assess import assess
from doe.criteria import UNASKED, catalogue
from doe.curve import accuracy_curve
from doe.day.day import day_of, quickest_order
from doe.notes import notes_of
from doe.optimal.search import WholePlan
from doe.plan import Candidates, Certificate, Design, Rival, named
from doe.problem import Problem, problem_of
from doe.problem.levels import at_level, levels_of, parse_levels
from doe.problem.pool import Pool, chunked, drawn, pool_of
from doe.problem.request import (
    CANDIDATES,
    CannotIdentify,
    Request,
    no_candidate,
)
from doe.solve import (
    Progress,
    check_count,
    choose,
    finish,
    new_poses_instead,
    with_second_visits,
)
from doe.visiting import (
    Reapproaches,
    reapproaches_of,
    usual_reapproaches,
    with_reapproaches,
)

_MOST_POSES = 10_000


@one_blas_thread
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
    repeats: bool | None = None,
    at_markers: bool | None = None,
    refine: bool | None = None,
    curve: bool = False,
    reapproach: int | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Design:
    """Choose poses that make a criterion best, with a certificate.

    poses : how many to choose; the cell's [design] or the levels say it otherwise
    criterion : "task", "task-worst", "D", "Ds", "A", "c", "E", "G" or one of an installed package
    levels : by joint, or in short "A2=5x3", "A2=-140,-57,-10x3"; those of the cell's [design] otherwise
    candidates : number of Sobol candidates, or a table of candidates in the format of a plan
    extend : a plan that is measured in any case, or what was measured; ``poses`` come on top of it
    discriminate : two effects ``effect:where`` that the plan is to tell apart, instead of a criterion
    of : effects or parameters that matter, for Ds, A, E and c (``NAME=FACTOR`` for a combination)
    against : plans to judge beside the result, by name
    repeats : whether a candidate may be used more than once; the cell's [design] otherwise
    at_markers : whether errors at the targets count at the markers, not at the tip's origin; by default
        where the markers are unknowns of the model
    refine : polish the joint angles; by default unless the candidates come from a table
    curve : also the best plans of fewer and of more poses
    reapproach : so many of the poses are visited again after the others, to show the arm's
        repeatability; 0 for none; the cell's [design] otherwise, and where that is silent and the
        repeatability is not known, a tenth of ``poses`` (doe.visiting.usual_reapproaches)
    progress : called with a line for each step

    Raises CalibError where no such plan can be: the text says why and what would help.
    """
    asked = parse_levels(cell, levels) if isinstance(levels, str) else levels
    source = load_plan(cell, candidates) if isinstance(candidates, str | Path) else candidates
    if isinstance(source, int) and source < 1:
        raise CalibError(f"{source} candidates are too few; ask for a thousand or more")
    again = reapproaches_of(cell, reapproach)
    chosen_levels = levels_of(cell, asked, poses)
    request = Request(
        poses=_count(cell, poses, None if chosen_levels is None else chosen_levels.poses),
        criterion=_criterion(criterion, discriminate, tuple(of)),
        levels=chosen_levels,
        of=tuple(of),
        rivals=discriminate,
        fixed=None if extend is None else _extended(cell, extend),
        repeats=cell.design.repeats if repeats is None else repeats,
        at_markers=at_markers,
        candidates=source,
        refine=isinstance(source, int) if refine is None else refine,
        curve=curve,
        reapproaches=again or 0,
        seed=seed,
    )
    all_chosen = isinstance(source, Poses) and len(source) <= request.poses
    if again is None and not all_chosen:
        found = _with_usual_reapproaches(cell, request, against or {}, progress)
        if found is not None:
            return found
    return _designed(cell, request, against or {}, Progress(progress))


def _with_usual_reapproaches(
    cell: Cell,
    request: Request,
    against: Mapping[str, Poses],
    tell: Callable[[str], None],
) -> Design | None:
    """The plan with second visits among its poses; None where it cannot spare them."""
    again = usual_reapproaches(cell, request)
    if not again:
        return None
    fewer = replace(request, poses=request.poses - again, reapproaches=again, asked=False)
    try:
        return _designed(cell, fewer, against, Progress(tell))
    except CannotIdentify:
        return None


def _count(cell: Cell, poses: int | None, by_levels: int | None) -> int:
    found = poses or by_levels or cell.design.poses
    if not found:
        raise CalibError("how many poses? ask for a number, or give poses in the cell's [design]")
    own = cell.design.poses
    if poses is None and by_levels and own and own != by_levels:
        raise CalibError(
            f"the levels make {by_levels} poses and [design] poses is {own}; change one of them"
        )
    if found > _MOST_POSES:
        raise CalibError(f"{found} poses are too many to choose; ask for at most {_MOST_POSES}")
    return int(found)


def _criterion(name: str, discriminate: tuple[str, str] | None, of: tuple[str, ...]) -> str:
    if of and (discriminate is not None or name not in ("Ds", "A", "E", "c")):
        said = "two rivals" if discriminate is not None else f"criterion {name}"
        raise CalibError(f"parameters of interest say nothing to {said}, but to Ds, A, E and c")
    if discriminate is not None:
        return UNASKED
    if name not in catalogue() or name == UNASKED:
        known = ", ".join(n for n in catalogue() if n != UNASKED)
        raise InputError("criterion", "", f"{name!r} is unknown", f"known are {known}")
    return name


def _extended(cell: Cell, given: str | Path | Poses | Measurements) -> Poses:
    """What is measured in any case, as poses of a plan: each is read free and, with a load, loaded."""
    if isinstance(given, str | Path):
        given = (load_measurements if holds_points(given) else load_plan)(cell, given)
    if isinstance(given, Poses):
        return given
    poses = given.poses
    loaded = poses.wrench.any(axis=1) | (poses.load_mass != 0.0)
    return poses.take(loaded) if cell.load is not None and loaded.any() else poses


def _designed(
    cell: Cell,
    request: Request,
    against: Mapping[str, Poses],
    progress: Progress,
) -> Design:
    follows = _follows_levels(cell, request)
    problem = problem_of(_with_even_knots(cell, request) if follows else cell, request)
    progress.tell(f"{len(problem.model.parameters)} parameters, {request.poses} poses")
    pool = _pool(problem)
    progress.lap("pool")
    progress.tell(f"{len(pool)} of {pool.drawn} candidates are feasible")
    check_count(problem, pool)
    chosen = choose(problem, pool, progress)
    levels = request.levels
    if levels is not None and not levels.chosen:
        settled = levels.only(np.unique(pool.q[chosen.plan, levels.joint]))
        if follows:
            progress.tell("levels chosen; the model's angles follow them")
            there = _designed(cell, replace(request, levels=settled), against, progress)
            note = (
                f"levels chosen among {len(levels.values)}, at least "
                f"{chosen.value / chosen.relaxed.bound:.3f} of the best choice for a model with even "
                "knots; the efficiency is for the levels as chosen"
            )
            return replace(there, notes=(note, *there.notes))
        levels = settled
    final, found, certificate = finish(problem, pool, chosen, progress)
    live = len(problem.posed(final).survivors(found.relaxed.G, found.value))
    poses, again, certificate = _visited(problem, final, found, certificate)
    result = Design(
        problem=problem,
        poses=poses,
        levels=levels,
        assessment=assess(problem, poses.q),
        certificate=certificate,
        candidates=Candidates(pool.drawn, len(pool), pool.removed, live),
        rivals=_judged(problem, against, certificate.bound),
        curve=accuracy_curve(problem, pool) if request.curve else (),
        seconds=progress.laps,
        reapproaches=again,
        day=day_of(cell, poses),
    )
    progress.lap("judgement")
    return replace(result, notes=notes_of(result))


def _visited(
    problem: Problem, pool: Pool, found: WholePlan, certificate: Certificate
) -> tuple[Poses, Reapproaches | None, Certificate]:
    """The poses in the order of a day, with those that are read again, and what is proved of them."""
    request, q, again = problem.request, pool.q[found.plan], None
    poses = named(q[quickest_order(problem.cell, q)])
    if request.reapproaches:
        poses, again = with_reapproaches(problem, poses, request.reapproaches)
        certificate = with_second_visits(
            problem, pool, found, certificate, poses.q[-len(again.again) :]
        )
        instead = new_poses_instead(problem, pool, found.plan, len(again.again))
        again = replace(again, task_rms_instead=instead, asked=request.asked)
    return replace(poses, order=np.arange(float(len(poses)))), again, certificate


def _follows_levels(cell: Cell, request: Request) -> bool:
    """Whether levels are to be chosen and the model has a coefficient at each of them."""
    levels = request.levels
    if levels is None or levels.chosen or cell.robot.joints[levels.joint] in cell.knots:
        return False
    joint = cell.robot.joints[levels.joint]
    placed = [parse_effect(text) for text in cell.effects]
    kind = StiffnessVsAngle.kind
    return any(name == kind and (where is None or joint in where) for name, where in placed)


def _with_even_knots(cell: Cell, request: Request) -> Cell:
    """As many coefficients as levels, evenly over the joint's range, while the levels are chosen."""
    if request.levels is None:
        return cell
    levels, grid = request.levels, request.levels.values
    knots = {cell.robot.joints[levels.joint]: np.linspace(grid[0], grid[-1], levels.used)}
    return replace(cell, knots={**cell.knots, **knots})


def _pool(problem: Problem) -> Pool:
    """Candidates, enough of them at every level. Raises CalibError saying what removed them."""
    levels, source = problem.request.levels, problem.request.candidates
    if isinstance(source, Poses):
        chunks, count = chunked(source.q), len(source)
    else:
        seed, count = problem.request.seed, source
        chunks = drawn(problem.cell, count, levels, seed)
    pool = pool_of(problem.regressor, problem.constraints, levels, chunks, count)
    if problem.request.fixed is not None and not problem.request.repeats:
        pool = pool.without(problem.request.fixed.q)
    if not len(pool):
        raise CalibError(no_candidate(pool.drawn, pool.removed))
    rules = problem.rules(pool.level)
    if isinstance(source, Poses):
        _check_rows(problem, source)
    if rules.chooses_levels:
        if not np.isfinite(rules.best(np.zeros(len(pool)))[0]):
            where = f" for each of {rules.used} levels far enough apart"
            raise CalibError(no_candidate(pool.drawn, pool.removed, where))
        return pool
    for level, members in enumerate(rules.members):
        needed = 1 if rules.repeats else int(rules.counts[level])
        if len(members) < needed:
            raise CalibError(pool.too_few(problem.cell, levels, level, len(members), needed))
    return pool


def _check_rows(problem: Problem, table: Poses) -> None:
    """Refuse a table of candidates without a row at a level that is wanted."""
    levels = problem.request.levels
    if levels is None or not levels.chosen:
        return
    for level in np.setdiff1d(np.arange(len(levels.values)), levels.of(table.q)):
        where = at_level(problem.cell, levels, int(level))
        raise CalibError(f"the table of candidates has no row{where}; add some")


def _judged(problem: Problem, against: Mapping[str, Poses], bound: float) -> dict[str, Rival]:
    found = {}
    for name, plan in against.items():
        M = problem.fixed + problem.information(plan.q).sum(axis=0)
        value = float(problem.criterion.plain.value(M))
        found[name] = Rival(assess(problem, plan.q), value / bound, plan.q)
    return found
