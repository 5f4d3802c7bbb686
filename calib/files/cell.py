"""Read ``cell.toml``: the checked table to SI, with what it names beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Capsule, Robot, Shapes
from calib.arm.se3 import from_xyz_rpy
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Cell, Load, Repeatability
from calib.cell.acceptance import Acceptance
from calib.cell.planned import AskedLevels, Ball, Body, Box, HalfSpace, Planned, Targets
from calib.errors import InputError, UnknownEffect
from calib.files import schema
from calib.files.cell_table import cell_table
from calib.files.estimate import load_prior
from calib.files.instruments import bodies_of, instruments_of, known_distances
from calib.files.lenses import with_lenses
from calib.files.robot import load_robot
from calib.files.schema import (
    AcceptanceTable,
    CellFile,
    LoadTable,
    MarkerTable,
    PriorTable,
    RobotTable,
)
from calib.files.tables import load_targets
from calib.files.values import MM, URAD
from calib.model.build import context_of, parse_effect, parse_excluded

_HOUR = 3600.0


def planned(path: Path, robot: Robot, table: schema.DesignTable) -> Planned:
    """What the table says, all but its targets.

    Raises InputError where levels are neither counted nor given, or both.
    """
    for joint, levels in table.levels.items():
        if (levels.count is None) == (levels.values_deg is None):
            raise InputError(
                path, f"design.levels.{joint}", "needs either count or values_deg, and not both"
            )
    return Planned(
        poses=table.poses,
        levels={
            joint: _levels(levels, robot.prismatic[robot.joints.index(joint)])
            for joint, levels in table.levels.items()
        },
        targets_after=None if table.targets_after_h is None else table.targets_after_h * _HOUR,
        repeats=table.repeats,
        reference_every=table.reference_every,
        reapproaches=table.reapproaches,
        floor=table.floor_mm * MM if isinstance(table.floor_mm, float) else None,
        floorless=table.floor_mm is False,
        obstacles=tuple(_body(obstacle) for obstacle in table.obstacle),
    )


def with_targets(cell: Cell, file: str | None) -> Cell:
    """The cell with the targets of a file beside it. Raises InputError."""
    if file is None:
        return cell
    path = cell.path.parent / file
    return replace(
        cell, design=replace(cell.design, targets=Targets(path, *load_targets(cell, path)))
    )


def _levels(table: schema.LevelsTable, slides: bool) -> AskedLevels:
    """Of a joint that slides, ``_deg`` stands for millimetres."""
    unit = MM if slides else math.pi / 180.0
    values = None if table.values_deg is None else np.sort(np.array(table.values_deg)) * unit
    count = table.count if values is None else len(values)
    return AskedLevels(table.poses_per_level, count, values, table.min_separation_deg * unit)


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


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table, lenses = with_lenses(path, cell_table(path))
    form, file = table.robot.form, path.parent / table.robot.file
    convention = table.robot.dh_convention
    robot = load_robot(form, file, table.robot.base, table.robot.tip, convention)
    _check_joints(path, robot, table)
    _check_effects(path, table.model.effects)
    markers = {
        name: m if isinstance(m, MarkerTable) else MarkerTable(position=m)
        for name, m in table.markers_mm.items()
    }
    given = "capsules_mm" in table.robot.model_fields_set
    bodies = bodies_of(path, table)
    every = [*markers.values(), *len(bodies.names) * [MarkerTable(position=(0.0, 0.0, 0.0))]]
    positions = np.array([m.position for m in markers.values()]).reshape(-1, 3)
    cell = Cell(
        name=table.name or path.stem,
        path=path,
        robot=_narrowed(path, robot, table.robot),
        marker_names=(*markers, *bodies.names),
        markers=np.concatenate([positions * MM, bodies.markers]),
        marker_normals=np.array([_unit(m.normal) for m in every]),
        marker_acceptance=np.radians([m.acceptance_deg or math.nan for m in every]),
        instruments=instruments_of(table, bodies),
        gravity=np.array(table.gravity.m_s2),
        payload=Payload(table.payload.mass_kg, _metres(table.payload.com_mm)),
        load=_load(table.load),
        effects=tuple(table.model.effects),
        knots={j: np.sort(np.radians(angles)) for j, angles in table.model.knots_deg.items()},
        anchors={
            j: np.array([a.before, a.after]) * MM for j, a in table.robot.compensators_mm.items()
        },
        shapes=Shapes(_capsules(table.robot)) if given else robot.shapes,
        lens_files=lenses,
        design=planned(path, robot, table.design),
        repeatability=_repeatability(table.robot),
        gear_ratios=dict(table.robot.gear_ratio),
        known_distances=known_distances(path, table),
        bodies=bodies.parts,
        acceptance=_acceptance(table.acceptance),
        size_prior=table.model.size_prior,
        about={key: str(value) for key, value in table.report.items()},
    )
    cell = replace(cell, excluded=_excluded(cell, table.diagnosis.exclude))
    return _with_prior(with_targets(cell, table.design.targets), table.model.prior)


def _check_effects(path: Path, effects: Sequence[str]) -> None:
    for text in effects:
        try:
            parse_effect(text)
        except UnknownEffect as error:
            raise InputError(path, "model.effects", str(error)) from None


def _load(table: LoadTable | None) -> Load | None:
    if table is None:
        return None
    return Load(table.mass_kg, _metres(table.com_mm), math.radians(table.max_tilt_deg))


def _acceptance(table: AcceptanceTable | None) -> Acceptance | None:
    return None if table is None else Acceptance(table.tolerance_mm * MM, table.rule)


def _with_prior(cell: Cell, table: PriorTable | None) -> Cell:
    """The cell with what its robot's type knows."""
    if table is None:
        return cell
    source = cell.path.parent / table.file
    return replace(cell, prior=load_prior(source, cell), prior_file=source)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    joints = set(robot.joints)
    named: list[tuple[str, Iterable[str]]] = [
        ("robot.limits_deg", table.robot.limits_deg),
        ("robot.limits_mm", table.robot.limits_mm),
        ("robot.compensators_mm", table.robot.compensators_mm),
        ("robot.gear_ratio", table.robot.gear_ratio),
        ("robot.capsules_mm", set(table.robot.capsules_mm) - {"base", "tool"}),
        ("design.levels", table.design.levels),
        ("model.knots_deg", table.model.knots_deg),
    ]
    for key, names in named:
        for name in names:
            if name not in joints:
                raise InputError(
                    path, f"{key}.{name}", "no such joint", f"joints are {', '.join(robot.joints)}"
                )
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
                known = "{:g} .. {:g}".format(*(robot.limits[index] / unit))
                raise InputError(
                    path,
                    f"robot.{key}.{joint}",
                    f"leaves nothing of the {table.form.upper()}'s limits",
                    f"those are {known}",
                )
    narrowed = replace(robot, limits=limits)
    for joint, (low, high) in zip(robot.joints, narrowed.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            what = f"leave nothing to {joint}, which moves with others"
            raise InputError(
                path, "robot", f"limits {what}", "widen those in the cell or robot's file"
            )
    return narrowed


def _capsules(table: RobotTable) -> dict[str, tuple[Capsule, ...]]:
    return {
        name: tuple(Capsule(_metres(c.start), _metres(c.end), c.radius * MM) for c in capsules)
        for name, capsules in table.capsules_mm.items()
    }


def _repeatability(table: RobotTable) -> Repeatability | None:
    """As stated; what is not stated beside the other is none."""
    stated = table.repeatability_mm, table.repeatability_urad
    if stated == (None, None):
        return None
    return Repeatability((stated[0] or 0.0) * MM, (stated[1] or 0.0) * URAD)


def _excluded(cell: Cell, names: list[str]) -> tuple[str, ...]:
    context = context_of(cell, None)
    try:
        return tuple(cause for name in names for cause in parse_excluded(name, context))
    except UnknownEffect as error:
        raise InputError(cell.path, "diagnosis.exclude", str(error)) from None


def _unit(vector: tuple[float, float, float] | None) -> Array:
    if vector is None:
        return np.full(3, math.nan)
    direction = np.array(vector)
    return np.asarray(direction / np.linalg.norm(direction))


def _metres(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = vector
    return x * MM, y * MM, z * MM
