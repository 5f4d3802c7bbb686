"""Read ``cell.toml``: its checked tables, and the files that it names, as a cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from calib.arm.robot import Robot, Shapes
from calib.arm.statics import Payload
from calib.cell import Cell
from calib.cell.planned import Planned, Targets
from calib.errors import InputError, UnknownEffect
from calib.files.cell_robot import frame_of, robot_of
from calib.files.cell_table import cell_table
from calib.files.instruments import bodies_of, instruments_of, known_distances
from calib.files.schema import CellFile, MarkerTable, RobotTable
from calib.files.tables import load_targets
from calib.keys import MM
from calib.model.build import context_of, parse_effect, parse_excluded

_BLANK = MarkerTable(position=(0.0, 0.0, 0.0))


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table = cell_table(path)
    robot = robot_of(path, table)
    _check_effects(path, table.model.effects)
    bodies = bodies_of(path, table)
    markers = [*table.markers_mm.values(), *len(bodies.names) * [_BLANK]]
    positions = np.array([own.position for own in table.markers_mm.values()]).reshape(-1, 3)
    normals = np.array([own.normal or 3 * [math.nan] for own in markers]).reshape(-1, 3)
    anchors, tolerance = table.robot.compensators_mm, table.acceptance
    cell = Cell(
        robot,
        np.concatenate([positions * MM, bodies.markers]),
        instruments_of(path, table, bodies),
        table.model.effects,
        name=table.name or path.stem,
        path=path,
        marker_names=(*table.markers_mm, *bodies.names),
        marker_normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        marker_acceptance=np.radians([own.acceptance_deg or math.nan for own in markers]),
        marker_links=(*map(table.link_of, table.markers_mm), *bodies.links) if table.links else (),
        gravity=np.array(table.gravity.m_s2),
        payload=_payload(table, robot),
        load=table.load,
        knots=table.model.knots_deg,
        anchors={joint: np.array([own.before, own.after]) for joint, own in anchors.items()},
        shapes=_shapes(robot, table.robot),
        design=planned(path, robot, replace(table.design, targets=None)),
        pace=table.timing,
        repeatability=table.robot.repeatability,
        gear_ratios=table.robot.gear_ratio,
        known_distances=known_distances(path, table),
        bodies=bodies.parts,
        seats=bodies.seats,
        tolerance=tolerance and tolerance.tolerance_mm * MM,
        size_prior=table.model.size_prior,
        about=table.report,
    )
    cell = replace(cell, excluded=_excluded(cell, table.diagnosis.exclude))
    return with_targets(cell, cast("str | None", table.design.targets))


def _check_effects(path: Path, effects: Sequence[str]) -> None:
    for text in effects:
        try:
            parse_effect(text)
        except UnknownEffect as error:
            raise InputError(path, "model.effects", str(error)) from None


def _payload(table: CellFile, robot: Robot) -> Payload:
    x, y, z = (MM * own for own in table.payload.com_mm)
    return Payload(table.payload.mass_kg, (x, y, z), frame_of(robot, table.payload.on))


def _shapes(robot: Robot, table: RobotTable) -> Shapes:
    """What the cell says of them in place of the robot's file, which may be that there are none."""
    given = table.capsules_mm
    if given is None:
        return robot.shapes
    return Shapes({name: tuple(own.capsule for own in several) for name, several in given.items()})


def planned(path: Path, robot: Robot, design: Planned) -> Planned:
    """The design with levels in the units of their joints.

    Raises InputError where levels are neither counted nor given, or both.
    """
    levels = {}
    for joint, asked in design.levels.items():
        if (asked.count is None) == (asked.values is None):
            what = "needs either count or values_deg, and not both"
            raise InputError(path, f"design.levels.{joint}", what)
        slides = robot.prismatic[robot.joints.index(joint)]
        asked = asked.in_millimetres() if slides else asked
        count = asked.count if asked.values is None else len(asked.values)
        levels[joint] = replace(asked, count=count)
    return replace(design, levels=levels)


def _excluded(cell: Cell, causes: Sequence[str]) -> tuple[str, ...]:
    """Names of causes, each with its place. Raises InputError."""
    try:
        context = context_of(cell, None)
        return tuple(own for name in causes for own in parse_excluded(name, context))
    except UnknownEffect as error:
        raise InputError(cell.path, "diagnosis.exclude", str(error)) from None


def with_targets(cell: Cell, file: str | None) -> Cell:
    """The cell with the targets of a file beside it. Raises InputError."""
    if file is None:
        return cell
    path = cell.path.parent / file
    found = Targets(path, *load_targets(cell, path))
    return replace(cell, design=replace(cell.design, targets=found))
