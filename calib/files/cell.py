"""Read ``cell.toml``: the checked table to SI, with what it names beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Capsule, Robot, Shapes
from calib.arm.se3 import from_xyz_rpy
from calib.arm.statics import Payload
from calib.cell import Cell, Load, Repeatability
from calib.cell.planned import (
    AskedLevels,
    Ball,
    Body,
    Box,
    HalfSpace,
    Pace,
    Planned,
    Targets,
)
from calib.errors import InputError, UnknownEffect
from calib.files import schema
from calib.files.cell_table import cell_table
from calib.files.couplings import coupled
from calib.files.instruments import bodies_of, instruments_of, known_distances
from calib.files.robot import load_robot
from calib.files.schema import (
    CellFile,
    MarkerTable,
    RobotTable,
)
from calib.files.tables import load_targets
from calib.files.values import MM, URAD
from calib.instruments.protocol import TIP
from calib.model.build import context_of, parse_effect, parse_excluded

_HOUR = 3600.0


def planned(path: Path, robot: Robot, table: schema.DesignTable) -> Planned:
    """What the table says, all but its targets.

    Raises InputError where levels are neither counted nor given, or both.
    """
    asked = {}
    for joint, levels in table.levels.items():
        if (levels.count is None) == (levels.values_deg is None):
            what = "needs either count or values_deg, and not both"
            raise InputError(path, f"design.levels.{joint}", what)
        # Of a joint that slides, ``_deg`` stands for millimetres.
        unit = MM if robot.prismatic[robot.joints.index(joint)] else math.pi / 180.0
        values = None if levels.values_deg is None else np.sort(levels.values_deg) * unit
        count = levels.count if values is None else len(values)
        apart = levels.min_separation_deg * unit
        asked[joint] = AskedLevels(levels.poses_per_level, count, values, apart)
    return Planned(
        poses=table.poses,
        levels=asked,
        targets_after=None if table.targets_after_h is None else table.targets_after_h * _HOUR,
        repeats=table.repeats,
        reapproaches=table.reapproaches,
        floor=None if table.floor_mm is None else table.floor_mm * MM,
        margin=table.margin_mm * MM,
        obstacles=tuple(_body(obstacle) for obstacle in table.obstacle),
    )


def with_targets(cell: Cell, file: str | None) -> Cell:
    """The cell with the targets of a file beside it. Raises InputError."""
    if file is None:
        return cell
    path = cell.path.parent / file
    found = Targets(path, *load_targets(cell, path))
    return replace(cell, design=replace(cell.design, targets=found))


def _body(table: schema.BoxTable | schema.BallTable | schema.HalfSpaceTable) -> Body:
    match table:
        case schema.BoxTable():
            T = from_xyz_rpy(np.array(table.center_mm) * MM, np.radians(table.rpy_deg))
            return Box(T, 0.5 * MM * np.array(table.size_mm))
        case schema.BallTable():
            return Ball(np.array(table.center_mm) * MM, table.radius_mm * MM)
        case _:
            return HalfSpace(np.array(table.point_mm) * MM, np.array(table.normal))


_ROUNDED = 1e-9  # rad or m
_DRIVES = (
    ("speed_deg_s", math.pi / 180, False),
    ("speed_mm_s", MM, True),
    ("acceleration_deg_s2", math.pi / 180, False),
    ("acceleration_mm_s2", MM, True),
)
"""Keys of what the drives give, the unit, and whether they are of joints that slide."""


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table = cell_table(path)
    own, file = table.robot, path.parent / table.robot.file
    robot = load_robot(own.form, file, own.base, own.tip, own.dh_convention, table.links)
    _check_joints(path, robot, table)
    robot = coupled(path, robot, own.coupled)
    if table.load is not None:
        robot = replace(robot, loaded=_frame(robot, table.load.on))
    for text in table.model.effects:
        try:
            parse_effect(text)
        except UnknownEffect as error:
            raise InputError(path, "model.effects", str(error)) from None
    markers = {
        name: m if isinstance(m, MarkerTable) else MarkerTable(position=m)
        for name, m in table.markers_mm.items()
    }
    bodies = bodies_of(path, table)
    every = [*markers.values(), *len(bodies.names) * [MarkerTable(position=(0.0, 0.0, 0.0))]]
    positions = np.array([m.position for m in markers.values()]).reshape(-1, 3)
    normals = np.array([m.normal or 3 * [math.nan] for m in every]).reshape(-1, 3)
    load, asked = table.load, table.acceptance
    cell = Cell(
        name=table.name or path.stem,
        path=path,
        robot=_driven(path, _narrowed(path, robot, own), own),
        marker_names=(*markers, *bodies.names),
        markers=np.concatenate([positions * MM, bodies.markers]),
        marker_normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        marker_acceptance=np.radians([m.acceptance_deg or math.nan for m in every]),
        instruments=instruments_of(path, table, bodies),
        gravity=np.array(table.gravity.m_s2),
        payload=_payload(table, robot),
        load=None
        if load is None
        else Load(load.mass_kg, _metres(load.com_mm), math.radians(load.max_tilt_deg)),
        effects=tuple(table.model.effects),
        knots={j: np.sort(np.radians(angles)) for j, angles in table.model.knots_deg.items()},
        anchors={j: np.array([a.before, a.after]) * MM for j, a in own.compensators_mm.items()},
        shapes=_stated_shapes(own) or robot.shapes,
        design=planned(path, robot, table.design),
        pace=_pace(table.timing),
        repeatability=_repeatability(own),
        gear_ratios=dict(own.gear_ratio),
        known_distances=known_distances(path, table),
        bodies=bodies.parts,
        seats=bodies.seats,
        tolerance=asked and asked.tolerance_mm * MM,
        size_prior=table.model.size_prior,
        about={key: str(value) for key, value in table.report.items()},
        marker_links=(*map(table.link_of, table.markers_mm), *bodies.links) if table.links else (),
    )
    try:
        context = context_of(cell, None)
        excluded = [c for name in table.diagnosis.exclude for c in parse_excluded(name, context)]
    except UnknownEffect as error:
        raise InputError(path, "diagnosis.exclude", str(error)) from None
    cell = replace(cell, excluded=tuple(excluded))
    return with_targets(cell, table.design.targets)


def _payload(table: CellFile, robot: Robot) -> Payload:
    own = table.payload
    return Payload(own.mass_kg, _metres(own.com_mm), _frame(robot, own.on))


def _frame(robot: Robot, on: str) -> int:
    """Frame of the tip that is named so."""
    return -1 if on == TIP else robot.dof + 1 + robot.tips.index(on)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    joints = set(robot.joints)
    named: list[tuple[str, Iterable[str]]] = [
        ("robot.limits_deg", table.robot.limits_deg),
        ("robot.limits_mm", table.robot.limits_mm),
        *((f"robot.{key}", getattr(table.robot, key)) for key, *_ in _DRIVES),
        ("robot.compensators_mm", table.robot.compensators_mm),
        ("robot.gear_ratio", table.robot.gear_ratio),
        ("robot.coupled", table.robot.coupled),
        ("robot.capsules_mm", set(table.robot.capsules_mm) - {"base", "tool"}),
        ("design.levels", table.design.levels),
        ("model.knots_deg", table.model.knots_deg),
    ]
    for key, names in named:
        for name in names:
            if name not in joints:
                known = f"joints are {', '.join(robot.joints)}"
                raise InputError(path, f"{key}.{name}", "no such joint", known)
    for joint, angles in table.model.knots_deg.items():
        if not angles or len(set(angles)) < len(angles):
            raise InputError(path, f"model.knots_deg.{joint}", "needs angles, each one once")
        if robot.prismatic[robot.joints.index(joint)]:
            raise InputError(path, f"model.knots_deg.{joint}", "is a joint that slides, not turns")


def _narrowed(path: Path, robot: Robot, table: RobotTable) -> Robot:
    limits = robot.limits.copy()
    for key, given, unit, slides in (
        ("limits_deg", table.limits_deg, math.pi / 180, False),
        ("limits_mm", table.limits_mm, MM, True),
    ):
        for joint, bounds in given.items():
            index = robot.joints.index(joint)
            if bool(robot.prismatic[index]) is not slides:
                right, does = ("limits_deg", "turns") if slides else ("limits_mm", "slides")
                what = f"joint {joint} {does}: these are limits in another unit"
                remedy = f"write them in {right.rpartition('_')[2]} under [robot.{right}]"
                raise InputError(path, f"robot.{key}.{joint}", what, remedy)
            low, high = np.array(bounds) * unit
            limits[index] = max(limits[index, 0], low), min(limits[index, 1], high)
            if limits[index, 0] > limits[index, 1]:
                what = f"leaves nothing of the {table.form.upper()}'s limits"
                known = "those are {:g} .. {:g}".format(*(robot.limits[index] / unit))
                raise InputError(path, f"robot.{key}.{joint}", what, known)
    narrowed = replace(robot, limits=limits)
    for joint, (low, high) in zip(robot.joints, narrowed.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            what = f"limits leave nothing to {joint}, which moves with others"
            raise InputError(path, "robot", what, "widen those in the cell or robot's file")
    return narrowed


def _driven(path: Path, robot: Robot, table: RobotTable) -> Robot:
    """The robot with the speeds and accelerations that the cell gives in place of its own file's."""
    blank = np.full(robot.dof, math.nan)
    own = {"speed": robot.speeds, "acceleration": robot.accelerations}
    found = {name: blank.copy() if is_ is None else is_.copy() for name, is_ in own.items()}
    for key, unit, slides in _DRIVES:
        for joint, value in getattr(table, key).items():
            index = robot.joints.index(joint)
            if bool(robot.prismatic[index]) is not slides:
                does = "turns" if slides else "slides"
                right = next(k for k, _, s in _DRIVES if s is not slides and k[:5] == key[:5])
                what = f"joint {joint} {does}: this is in another unit"
                raise InputError(
                    path, f"robot.{key}.{joint}", what, f"write it under [robot.{right}]"
                )
            found[key.partition("_")[0]][index] = value * unit
    return replace(robot, speeds=found["speed"], accelerations=found["acceleration"])


def _pace(table: schema.TimingTable) -> Pace:
    return Pace(
        table.speed_percent / 100.0,
        table.settle_s,
        table.read_s,
        60.0 * table.load_change_min,
    )


def _stated_shapes(table: RobotTable) -> Shapes | None:
    """What the cell says of them in place of the robot's file, which may be that there are none."""
    if "capsules_mm" not in table.model_fields_set:
        return None
    return Shapes(
        {
            name: tuple(Capsule(_metres(c.start), _metres(c.end), c.radius * MM) for c in capsules)
            for name, capsules in table.capsules_mm.items()
        }
    )


def _repeatability(table: RobotTable) -> Repeatability | None:
    """As stated; what is not stated beside the other is none."""
    stated = table.repeatability_mm, table.repeatability_urad
    if stated == (None, None):
        return None
    return Repeatability((stated[0] or 0.0) * MM, (stated[1] or 0.0) * URAD)


def _metres(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = vector
    return x * MM, y * MM, z * MM
