"""Design problems on which speed and plans are measured: the demo's KR 270 with three markers.

Its elastostatic problem has nine parameters.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import calib
from calib import Cell
from calib.cell.planned import Planned, Targets
from doe.candidates import candidates_of
from doe.levels import levels_of, parse_levels
from doe.optimal.function import Selection
from doe.problem import Problem, problem_of
from doe.request import Request
from studies.demo.embedded import embedded_cell

ELASTIC = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
LEVELS = "A2=-140,-99.85,-56.9,-25.24,-0.01x3"  # Table II of the paper
PAPER_POSES = 15
_TARGETS = """pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg
t1,0,-90,90,0,45,0
t2,30,-70,100,20,60,30
t3,-30,-50,80,-30,-45,10
"""


def paper_cell(masses: bool = True) -> Cell:
    """The embedded cell with its compliances unknown, targets those of the milling task.

    masses : the links weigh
    """
    cell = replace(embedded_cell(), effects=ELASTIC)
    if not masses:
        light = replace(cell.robot, masses=np.zeros_like(cell.robot.masses))
        cell = replace(cell, robot=light)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "targets.csv"
        path.write_text(_TARGETS)
        targets = Targets(path, *calib.load_targets(cell, path))
    return replace(cell, design=Planned(targets=targets))


def problem(cell: Cell, criterion: str, poses: int = 20, levels: str | None = None) -> Problem:
    """The design problem of a cell."""
    asked = parse_levels(cell, levels) if levels else None
    return problem_of(cell, Request(poses, criterion, levels_of(cell, asked, poses)))


def pool(posed: Problem, count: int) -> Selection:
    """The choice of a plan from so many candidates of a problem, seed 0."""
    drawn = candidates_of(posed.cell, posed.constraints, posed.request.levels, count, 0)
    return replace(posed, pool=drawn).posed()
