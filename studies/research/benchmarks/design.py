"""Branch and bound to its end: fifteen poses at five levels as in the paper, and twenty without levels.

    python -m studies.research.benchmarks.design [--candidates 1000] .. [--criterion D] .. [--json FILE]

The robot is the demo's KR 270 with three markers, its elastostatic problem has nine parameters.
:data:`CASES` holds further problems of it, on which other benchmarks measure.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np
import scipy.linalg  # noqa: F401 -- with its threads, before they are limited

import calib
from calib import Cell
from calib.arrays import Array
from calib.cell.planned import Planned, Targets
from doe.optimal.blocks import Blocks, pack
from doe.optimal.branch import prove
from doe.optimal.relax import bounded, relax
from doe.optimal.search import best_plan
from doe.problem import RIDGE, Problem, problem_of
from doe.problem.levels import levels_of, parse_levels
from doe.problem.pool import Pool, drawn, pool_of
from doe.problem.request import Request
from studies.demo.embedded import embedded_cell
from studies.research.bench import Output, Row, bench, each, several, table

CRITERIA = ("D", "A", "task")
T = TypeVar("T")

ELASTIC = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
LEVELS = "A2=-140,-99.85,-56.9,-25.24,-0.01x3"  # Table II of the paper
TARGETS = """pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg
t1,0,-90,90,0,45,0
t2,30,-70,100,20,60,30
t3,-30,-50,80,-30,-45,10
"""
ENOUGH = 2.0  # seconds of repeated runs after which there are no more


@dataclass(frozen=True)
class Case:
    """A model of the embedded cell. The levels are those of Table II, or none."""

    effects: tuple[str, ...]
    poses: int = 20
    levels: str | None = None
    loaded: bool = True
    masses: bool = True


CASES = {
    "paper": Case(ELASTIC, 15, LEVELS),
    "paper, no masses": Case(ELASTIC, 15, LEVELS, masses=False),
    "elastic": Case(ELASTIC),
    "geometric": Case(("base", "tool", "geometry"), loaded=False),
}


def cell_of(case: Case) -> Cell:
    """The embedded cell with the model of a case, targets those of the milling task."""
    with tempfile.TemporaryDirectory() as folder:
        targets = Path(folder) / "targets.csv"
        targets.write_text(TARGETS)
        cell: Cell = replace(embedded_cell(), effects=case.effects)
        if not case.loaded:
            cell = replace(cell, load=None)
        if not case.masses:
            robot = replace(cell.robot, masses=np.zeros_like(cell.robot.masses))
            cell = replace(cell, robot=robot)
        own = Targets(targets, *calib.load_targets(cell, targets))
        return replace(cell, design=Planned(targets=own))


def problem(name: str, criterion: str) -> Problem:
    """The design problem of a case."""
    case = CASES[name]
    cell = cell_of(case)
    asked = parse_levels(cell, case.levels) if case.levels else None
    levels = levels_of(cell, asked, case.poses)
    return problem_of(cell, Request(case.poses, criterion, levels))


def pool(posed: Problem, count: int) -> Pool:
    """Candidates of a problem, seed 0."""
    levels = posed.request.levels
    chunks = drawn(posed.cell, count, levels, 0)
    return pool_of(posed.regressor, posed.constraints, levels, chunks, count)


def timed(work: Callable[[], T], enough: float = ENOUGH) -> tuple[T, float]:
    """Result and median seconds of three runs, fewer once they took ``enough`` seconds."""
    seconds: list[float] = []
    result: T | None = None
    while len(seconds) < 3 and sum(seconds) < enough:
        result = None  # two large results at once would count in the peak memory
        begun = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - begun)
    assert result is not None  # noqa: S101
    return result, statistics.median(seconds)


def blocks_of(matrices: Array) -> Blocks:
    """Blocks of given information matrices, (n, p, p)."""
    rank = int(np.linalg.matrix_rank(matrices[:50], tol=1e-8).max())
    return Blocks(pack(matrices), RIDGE * np.eye(matrices.shape[-1]), rank)


def branch(case: str, criterion: str, count: int) -> Row:
    """Branch and bound to its end, after relaxation and exchange."""
    posed = problem(case, criterion)
    drawn_pool = pool(posed, count)
    chosen = posed.posed(drawn_pool)
    relaxed = relax(chosen)
    found = best_plan(chosen, relaxed, seed=0)
    plain = chosen.by(posed.criterion.plain)
    G = bounded(plain, relaxed).G
    value = plain.value(found.plan)
    left = plain.survivors(G, value)
    begun = time.perf_counter()
    proof = prove(plain, found.plan, G, most_work=np.inf)
    return {
        "case": case,
        "criterion": criterion,
        "candidates": count,
        "gap of the relaxation": plain.bound(G) / proof.value - 1.0,
        "survivors": len(left),
        "optimal": proof.optimal,
        "nodes": proof.nodes,
        "seconds": time.perf_counter() - begun,
        "gap left": proof.bound / proof.value - 1.0,
        "gain over exchange": proof.value / value - 1.0,
    }


@bench(
    several("--candidates", (1000, 10_000, 100_000)), several("--criterion", CRITERIA), workers=True
)
def main(
    candidates: tuple[int, ...], criterion: tuple[str, ...], seed: int, workers: int
) -> Output:
    """Prove plans of the paper's case optimal."""
    del seed
    rows = each(branch, product(("paper", "elastic"), criterion, candidates), workers)
    return [table(rows)], rows


if __name__ == "__main__":
    main()
