"""What the columns of the tables mean: joints, loads and covariates, with their units."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.csv_table import Table
from calib.instruments.protocol import UNITS

_CLOCK = "time_s counts seconds: divide milliseconds since 1970 by 1000"
ANGLES, LENGTHS = UNITS["angle"], UNITS["length"]
TORQUES = ("N", "Nm")  # of a joint that slides, or turns
WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
SIGMAS = {"sigma_mm": ("mm", 1e-3), "sigma_px": ("px", 1.0), "sigma_urad": ("mrad", 1e-6)}
"""Standard deviations of single rows: unit of the numbers that they are of, and its size."""
OTHERS = (
    "pose",
    "marker",
    "instrument",
    "station",
    "session",
    "temperature_degC",
    "time_s",
    *SIGMAS,
    "level",
    "weight",
)

_MOST_TURNS = 100.0
_RADIANS_LOOK = 2 * math.pi + 0.1  # a whole table of degrees below this is probably radians


def joint_columns(path: Path, robot: Robot, columns: tuple[str, ...]) -> list[tuple[str, float]]:
    """Column and SI factor of each joint. Raises InputError where one is missing or has no unit."""
    found = []
    for joint, slides in zip(robot.joints, robot.prismatic, strict=True):
        units = LENGTHS if slides else ANGLES
        named = [(f"{joint}_{unit}", scale) for unit, scale in units.items()]
        present = [pair for pair in named if pair[0] in columns]
        if len(present) > 1:
            raise InputError(path, "line 1", f"joint {joint} stands in two units", "keep one")
        if not present:
            wanted = " or ".join(name for name, _ in named)
            if joint in columns:
                raise InputError(
                    path, "line 1", f"column {joint!r} has no unit", f"name it {wanted}"
                )
            raise InputError(path, "line 1", f"no column for joint {joint}", f"add {wanted}")
        found.append(present[0])
    return found


def check_known(
    path: Path, robot: Robot, columns: tuple[str, ...], readings: set[str]
) -> tuple[str, ...]:
    """Warnings about columns that are ignored. Raises InputError for a joint that is not there.

    readings : columns that hold what the instruments read
    """
    units = ("deg", "rad", "mm", "m")
    known = {*OTHERS, *WRENCH, *readings}
    known |= {f"{j}_{u}" for j in robot.joints for u in units}
    known |= {f"approach_{j}" for j in robot.joints} | set(torque_columns(robot))
    ignored = []
    for name in columns:
        unit = name.rpartition("_")[2]
        if name in known or not name:
            continue
        if unit in ("deg", "rad") or name.startswith("approach_"):
            raise InputError(
                path,
                "line 1",
                f"column {name!r} names no joint of the robot",
                f"joints are {', '.join(robot.joints)}",
            )
        if name.partition("_")[0] in {c.partition("_")[0] for c in (*WRENCH, *OTHERS)}:
            close = difflib.get_close_matches(name, [*WRENCH, *OTHERS], n=1)
            raise InputError(
                path,
                "line 1",
                f"column {name!r} has no known unit",
                f"name it {(close or ['?'])[0]}",
            )
        meant = difflib.get_close_matches(name, [*OTHERS, *WRENCH], n=1, cutoff=0.8)
        if meant:
            what, remedy = f"column {name!r} is not known", f"did you mean {meant[0]!r}?"
            raise InputError(path, "line 1", what, remedy)
        ignored.append(name)
    return (f"{path}: ignored columns: {', '.join(ignored)}",) if ignored else ()


def torque_columns(robot: Robot) -> tuple[str, ...]:
    """Column of the torque, or force, that the arm measured at each joint."""
    force, torque = TORQUES
    return tuple(
        f"{joint}_{force if slides else torque}"
        for joint, slides in zip(robot.joints, robot.prismatic, strict=True)
    )


def joint_values(table: Table, robot: Robot) -> Array:
    """Joint values of every row, shape (rows, n), rad and m."""
    pairs = joint_columns(table.path, robot, table.columns)
    q = np.column_stack([table.numbers(name) * scale for name, scale in pairs])
    turns = np.abs(q) / (2.0 * math.pi)
    for row, j in np.argwhere((turns > _MOST_TURNS) & ~robot.prismatic)[:1]:
        raise table.fault(
            row,
            pairs[j][0],
            f"is an angle of {turns[row, j]:.0f} turns",
            "check its unit: counts of an encoder and angles of the motor are none of the joint",
        )
    return q


def joint_warnings(table: Table, robot: Robot, q: Array) -> tuple[str, ...]:
    """What is odd about joint values but may be meant: limits left, degrees that look like radians."""
    warnings = []
    turning = ~robot.prismatic
    in_degrees = [f"{j}_deg" in table.columns for j in np.array(robot.joints)[turning]]
    if turning.any() and all(in_degrees):
        largest = float(np.degrees(np.abs(q[:, turning]).max()))
        if 0.0 < largest < _RADIANS_LOOK and len(table.rows) > 2:
            warnings.append(
                f"{table.path}: joint angles reach only {largest:.3g} degrees: the range looks like "
                "radians; if so, name the columns <joint>_rad"
            )
    margin = 1e-4  # rad or m: rounding of the URDF's limits
    outside = (q < robot.limits[:, 0] - margin) | (q > robot.limits[:, 1] + margin)
    for j in np.flatnonzero(outside.any(axis=0)):
        row = int(np.flatnonzero(outside[:, j])[0])
        shown = q[row, j] * 1e3 if robot.prismatic[j] else math.degrees(q[row, j])
        unit = "mm" if robot.prismatic[j] else "deg"
        warnings.append(
            f"{table.path}: line {table.lines[row]}: joint {robot.joints[j]} at {shown:.2f} {unit} is "
            f"outside its limits ({int(outside[:, j].sum())} rows in all); check joint names and units"
        )
    return tuple(warnings)


def covariates(table: Table, robot: Robot, rows: IntArray) -> dict[str, Any]:
    """Optional columns, at one row for each pose."""
    found: dict[str, Any] = {}
    wrench = np.zeros((len(rows), 6))
    for i, name in enumerate(WRENCH):
        if name in table.columns:
            wrench[:, i] = table.numbers(name)[rows]
    found["wrench"] = wrench
    for key, name in (("temperature", "temperature_degC"), ("time", "time_s")):
        if name in table.columns:
            found[key] = table.numbers(name, remedy=_CLOCK if key == "time" else "")[rows]
    torques = torque_columns(robot)
    if _every_joint(table, torques):
        found["torque"] = np.column_stack([table.numbers(name)[rows] for name in torques])
    signs = tuple(f"approach_{joint}" for joint in robot.joints)
    if _every_joint(table, signs):
        approach = np.column_stack([table.numbers(name) for name in signs])
        bad = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))
        if len(bad):
            raise table.fault(int(bad[0, 0]), signs[int(bad[0, 1])], "is not -1, 0 or +1")
        found["approach"] = approach[rows]
    if "session" in table.columns:
        found["session"] = np.array(table.names("session"))[rows]
    if "station" in table.columns:
        names = table.names("station")
        stations = tuple(sorted(set(names)))
        found["stations"] = stations
        found["station"] = np.array([stations.index(names[row]) for row in rows])
    return found


def _every_joint(table: Table, names: tuple[str, ...]) -> bool:
    """Whether the columns of all joints are there. Raises InputError where only some are."""
    present = [name for name in names if name in table.columns]
    if present and len(present) < len(names):
        missing = next(name for name in names if name not in present)
        raise InputError(
            table.path,
            "line 1",
            f"column {missing!r} is missing beside {present[0]!r}",
            "give every joint's, or none",
        )
    return bool(present)
