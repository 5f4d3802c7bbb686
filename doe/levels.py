"""Levels: values of one joint at which the poses of a plan stand, given or to be chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.planned import AskedLevels
from calib.effects.elastic import StiffnessVsAngle
from calib.errors import CalibError
from calib.model.build import parse_effect

_GRID = 25  # even steps over the range of the joint, from which levels are chosen
_STEP = 1e-2  # degrees or millimetres, to which they are rounded
_MOST = 100  # levels that may be chosen
_AT_LEVEL = 1e-6  # rad or m


@dataclass(frozen=True, eq=False)
class AngleLevels:
    """Values of one joint at which the poses of a plan stand.

    joint : int
    values : ndarray, shape (L,), rad or m, ascending: the levels, or the grid to choose them from
    used, per_level : int
    separation : float, rad or m, least distance of two levels that are used
    """

    joint: int
    values: Array
    used: int
    per_level: int
    separation: float = 0.0

    @property
    def poses(self) -> int:
        """Number of poses of a plan."""
        return self.used * self.per_level

    @property
    def chosen(self) -> bool:
        """Whether the levels are given, so that nothing is left to choose."""
        return self.used == len(self.values)

    def of(self, q: Array) -> IntArray:
        """Level of each configuration (m, dof), -1 where its joint stands at none."""
        distance = np.abs(q[:, self.joint, None] - self.values)
        return np.where(distance.min(axis=1) < _AT_LEVEL, distance.argmin(axis=1), -1)

    def only(self, values: Array) -> AngleLevels:
        """The same with its levels settled, shape (k,), rad or m."""
        return AngleLevels(self.joint, values, len(values), self.per_level)


def parse_levels(cell: Cell, text: str) -> dict[str, AskedLevels]:
    """``A2=5x3`` (five levels of three poses) or ``A2=-140,-57,-10x3``, as levels by joint.

    Raises CalibError.
    """
    joint, equals, rest = (part.strip() for part in text.partition("="))
    values, x, per_level = rest.rpartition("x")
    try:
        if not (joint and equals and x):
            raise ValueError
        given = [float(value) for value in values.split(",")] if "," in values else None
        count = int(values) if given is None else len(given)
        if min(int(per_level), count) < 1 or not np.isfinite(given or 0.0).all():
            raise ValueError
    except ValueError:
        raise CalibError(
            f"levels {text!r} are not understood; write A2=5x3 for five levels of A2 with three poses "
            "each, or A2=-140,-57,-10x3 to give the angles"
        ) from None
    if given is None:
        return {joint: AskedLevels(int(per_level), count)}
    at = np.array(given) * _unit(cell, _index(cell, joint))
    return {joint: AskedLevels(int(per_level), count, at)}


def levels_of(
    cell: Cell, given: Mapping[str, AskedLevels] | None, poses: int | None
) -> AngleLevels | None:
    """Levels as asked for, else those of the cell's [design]; None for none.

    With the cell's levels a number of poses says how many stand at each.

    Raises CalibError where they do not fit the robot or the number of poses.
    """
    asked = cell.design.levels if given is None else given
    if not asked:
        return None
    if len(asked) > 1:
        raise CalibError(
            f"levels of {' and '.join(asked)}: one joint at a time; keep the one that matters"
        )
    ((joint, wanted),) = asked.items()
    kept = cell.design.levels.get(joint)
    if given is not None and kept is not None:
        # The cell's values where as many are asked for, and its separation.
        if wanted.values is None and kept.values is not None and kept.count == wanted.count:
            wanted = replace(wanted, values=kept.values)
        wanted = replace(wanted, separation=wanted.separation or kept.separation)
    index = _index(cell, joint)
    levels = (_chosen if wanted.values is None else _given)(cell, index, wanted)
    if poses is not None and given is None and poses % levels.used == 0:
        levels = replace(levels, per_level=max(1, poses // levels.used))
    if poses is not None and levels.poses != poses:
        few = poses < levels.used
        each = "need at least" if few else f"x {levels.per_level} poses are"
        remedy = "ask for more poses or fewer levels" if few else "change one of them"
        count = levels.used if few else levels.poses
        raise CalibError(
            f"{levels.used} levels of {joint} {each} {count} poses, not {poses}; {remedy}"
        )
    return levels


def _index(cell: Cell, joint: str) -> int:
    robot = cell.robot
    if joint not in robot.joints:
        raise CalibError(f"levels of {joint}: no such joint; joints are {', '.join(robot.joints)}")
    k = robot.joints.index(joint)
    if not robot.free[k]:
        lead = robot.joints[int(np.abs(robot.ties.matrix[k]).argmax())]
        raise CalibError(f"levels of {joint}: it moves with {lead}; give levels of {lead}")
    return k


def _given(cell: Cell, joint: int, asked: AskedLevels) -> AngleLevels:
    name, unit = cell.robot.joints[joint], _unit(cell, joint)
    low, high = cell.robot.sample_limits()[joint]
    values = np.sort(np.asarray(asked.values))
    if not len(values):
        raise CalibError(f"levels of {name} are empty; give some, or a count")
    for value in values[(values < low - _AT_LEVEL) | (values > high + _AT_LEVEL)]:
        raise CalibError(
            f"level {value / unit:g} of {name} is outside its limits "
            f"{low / unit:g} .. {high / unit:g}; move it inside"
        )
    if (np.diff(values) < _AT_LEVEL).any():
        raise CalibError(f"levels of {name} contain the same value twice; give each once")
    return AngleLevels(joint, values, len(values), asked.per_level)


def _chosen(cell: Cell, joint: int, asked: AskedLevels) -> AngleLevels:
    """Levels to choose from even steps over the range, and from the knots of the joint's model."""
    name, unit = cell.robot.joints[joint], _unit(cell, joint)
    low, high = cell.robot.sample_limits()[joint]
    used, separation = asked.count or 0, asked.separation
    if used > _MOST:
        raise CalibError(f"{used} levels of {name} are too many to choose; ask for at most {_MOST}")
    if separation * (used - 1) > high - low + _AT_LEVEL:
        raise CalibError(
            f"{used} levels of {name} cannot be {separation / unit:g} apart within "
            f"{low / unit:g} .. {high / unit:g}; ask for fewer or closer ones"
        )
    step = unit * _STEP
    even = np.linspace(low, high, max(_GRID, 2 * used + 1))
    # A grid as coarse as the levels themselves, so that some choice keeps its distance.
    apart = np.linspace(low, high, used) if separation and used > 1 else even[:0]
    knots = cell.knots.get(name, even[:0])
    rounded = np.round(np.concatenate([even, apart]) / step) * step
    inside = knots[(knots >= low) & (knots <= high)]
    grid = np.unique(np.clip(np.concatenate([rounded, inside]), low, high))
    grid = grid[np.append(True, np.diff(grid) > 0.5 * step)]
    return AngleLevels(joint, grid, used, asked.per_level, separation)


def with_even_knots(cell: Cell, levels: AngleLevels) -> Cell | None:
    """As many coefficients as levels, evenly over the joint's range, where both are to be chosen.

    None where they are given, or the model has no coefficients of that joint.
    """
    joint = cell.robot.joints[levels.joint]
    modelled = any(
        name == StiffnessVsAngle.kind and (where is None or joint in where)
        for name, where in map(parse_effect, cell.effects)
    )
    if levels.chosen or joint in cell.knots or not modelled:
        return None
    even = np.linspace(levels.values[0], levels.values[-1], levels.used)
    return replace(cell, knots={**cell.knots, joint: even})


def _unit(cell: Cell, joint: int) -> float:
    """SI per degree, or per millimetre of a joint that slides."""
    return 1e-3 if cell.robot.prismatic[joint] else np.pi / 180.0


def at_level(cell: Cell, levels: AngleLevels | None, level: int) -> str:
    """Words for one level, none without levels."""
    if levels is None:
        return ""
    unit = "mm" if cell.robot.prismatic[levels.joint] else "deg"
    shown = f"{levels.values[level] / _unit(cell, levels.joint):g} {unit}"
    return f" at {cell.robot.joints[levels.joint]} = {shown}"
