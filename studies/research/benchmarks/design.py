"""Design problems on which benchmarks measure: the demo's KR 270 with three markers.

Its elastostatic problem has nine parameters.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

import calib
from calib import Cell
from calib.arrays import Array
from calib.cell.planned import Planned, Targets
from doe.candidates import Pool, candidates_of
from doe.levels import levels_of, parse_levels
from doe.optimal.blocks import Blocks, pack
from doe.problem import RIDGE, Problem, problem_of
from doe.request import Request
from studies.demo.embedded import embedded_cell

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
    offered = candidates_of(posed.cell, posed.constraints, posed.request.levels, count, 0)
    return offered.informed(posed.regressor)


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
