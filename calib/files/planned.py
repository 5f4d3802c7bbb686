"""The [design] table of a cell in SI, and the targets that it names."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import AskedLevels, Ball, Body, Box, HalfSpace, Planned, Targets
from calib.errors import InputError
from calib.files import schema
from calib.files.tables import load_targets

_MM = 1e-3
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
        floor=table.floor_mm * _MM if isinstance(table.floor_mm, float) else None,
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
    unit = _MM if slides else math.pi / 180.0
    values = None if table.values_deg is None else np.sort(np.array(table.values_deg)) * unit
    count = table.count if values is None else len(values)
    return AskedLevels(table.poses_per_level, count, values, table.min_separation_deg * unit)


def _body(table: schema.BoxTable | schema.BallTable | schema.HalfSpaceTable) -> Body:
    match table:
        case schema.BoxTable():
            T = from_xyz_rpy(_metres(table.center_mm), np.radians(table.rpy_deg))
            return Box(T, 0.5 * _metres(table.size_mm))
        case schema.BallTable():
            return Ball(_metres(table.center_mm), table.radius_mm * _MM)
        case _:
            return HalfSpace(_metres(table.point_mm), np.array(table.normal))


def _metres(vector: tuple[float, float, float]) -> Array:
    return np.array(vector) * _MM
