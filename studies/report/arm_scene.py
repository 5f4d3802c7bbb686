"""What the picture of the arm is drawn from: plain numbers, whole millimetres in the base frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.errors import CalibError
from calib.identification.initial import initial_values
from calib.instruments import Tracker
from calib.model.build import build, parse_effect
from calib.poses import Measurements, Poses
from doe.constraints import Scene, hidden_by, scene_of
from studies.report.surroundings import Surroundings, surroundings, whole_mm

_SIGNS = {"deg": "\N{DEGREE SIGN}", "mm": " mm"}
_SLIM = 0.016  # arm lengths; radius of a link where the cell gives the arm no shape


@dataclass(frozen=True)
class Body:
    """A piece of the arm: the points between which its axis runs, and its radius in mm."""

    start: int
    end: int
    radius: int


@dataclass(frozen=True, eq=False)
class ArmScene:
    """The arm at m poses. Points are shared: everything names them by their number.

    name : str, of the cell
    poses : tuple of str, identifiers
    joints, units : tuple of str, names, and ``deg`` or ``mm``
    values : ndarray, shape (m, n), joint values in these units
    level : int, number of the joint whose values are the plan's levels, or None
    points : ndarray of int, shape (m, k, 3), mm
    still : int, how many points, the first ones, stand at one place at all poses
    chain : tuple of int, points from the base over the joints to the tip
    tip_axes : ndarray, shape (m, 3, 3), axes of the tip frame, one a row
    markers : tuple of str, names; marker_points : tuple of int
    hidden : dict, (pose, marker) -> why it is not in sight, or not measured
    seen : str, what the others are: ``in sight``, ``measured``, or empty where nobody knows
    bodies : tuple of Body; shaped : bool, whether they are the cell's capsules or mere links
    around : Surroundings
    """

    name: str
    poses: tuple[str, ...]
    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    level: int | None
    points: IntArray
    still: int
    chain: tuple[int, ...]
    tip_axes: Array
    markers: tuple[str, ...]
    marker_points: tuple[int, ...]
    hidden: dict[tuple[int, int], str]
    seen: str
    bodies: tuple[Body, ...]
    shaped: bool
    around: Surroundings

    def readout(self, pose: int) -> tuple[str, str]:
        """Joint values and markers of a pose in words."""
        row = zip(self.joint_words, self.values[pose], strict=True)
        joints = [f"{before}{_shown(value)}{after}" for (before, after), value in row]
        lost = self.lost(pose)
        seen = [name for j, name in enumerate(self.markers) if j not in lost]
        words = f"marker{'s'[: len(seen) > 1]} {', '.join(seen)}" if seen else "no marker"
        hidden = [f"{self.markers[j]} {self.hidden[pose, j]}" for j in lost]
        return " \N{MIDDLE DOT} ".join(joints), "; ".join(
            [f"{words} {self.seen}".rstrip(), *hidden]
        )

    @property
    def joint_words(self) -> list[tuple[str, str]]:
        """What stands before and after the value of each joint."""
        return [
            (f"{name} ", _SIGNS[unit] + " (level)" * (k == self.level))
            for k, (name, unit) in enumerate(zip(self.joints, self.units, strict=True))
        ]

    def lost(self, pose: int) -> tuple[int, ...]:
        """Markers that are not in sight, or not measured, at a pose."""
        return tuple(j for j in range(len(self.markers)) if (pose, j) in self.hidden)


def scene(cell: Cell, plan: Poses | Measurements, *, level_joint: str | None = None) -> ArmScene:
    """The arm of a cell at the poses of a plan, or at measured poses with their measured markers.

    level_joint : joint whose values are the levels of the plan

    Nominal arm. Which markers of a plan are hidden is what :func:`doe.constraints.hidden_by` says;
    measured ones are those with a reading, brought into the base frame by the placement from which
    an identification starts.

    Raises CalibError where there is no pose, or no such joint.
    """
    poses = plan.poses if isinstance(plan, Measurements) else plan
    robot = cell.robot
    if not len(poses):
        raise CalibError("there is no pose to draw")
    if level_joint is not None and level_joint not in robot.joints:
        raise CalibError(f"no joint {level_joint!r}; there are {', '.join(robot.joints)}")
    placed = scene_of(cell, poses.q)
    hidden, markers, seen = _markers(cell, plan, placed)
    ends = [end for capsule in placed.capsules for end in (capsule.start, capsule.end)]
    columns = [*placed.origins.swapaxes(0, 1), *markers.swapaxes(0, 1), *ends]
    points, number, still = shared(whole_mm(np.stack(columns, axis=1)))
    chain = tuple(point for point, _ in groupby(number[: robot.dof + 2].tolist()))
    tail = number[robot.dof + 2 :].tolist()
    arms = points[:, chain]
    length = float(np.linalg.norm(arms - arms[:, :1], axis=-1).max())
    values = np.where(robot.prismatic, poses.q * 1e3, np.degrees(poses.q))
    return ArmScene(
        name=cell.name,
        poses=poses.names,
        joints=robot.joints,
        units=tuple("mm" if slides else "deg" for slides in robot.prismatic),
        values=np.asarray(values.round(2) + 0.0),
        level=None if level_joint is None else robot.joints.index(level_joint),
        points=points,
        still=still,
        chain=chain,
        tip_axes=placed.frames.R[:, -1].swapaxes(1, 2),
        markers=cell.marker_names,
        marker_points=tuple(tail[: len(cell.markers)]),
        hidden=hidden,
        seen=seen,
        bodies=_capsules(placed, tail[len(cell.markers) :]) or _links(chain, _SLIM * length),
        shaped=bool(placed.capsules),
        around=surroundings(cell, arms.reshape(-1, 3), length),
    )


def _markers(
    cell: Cell, plan: Poses | Measurements, placed: Scene
) -> tuple[dict[tuple[int, int], str], Array, str]:
    """Why markers are not there, where they are (m, M, 3) m, and what those are that are there."""
    hidden = hidden_by(placed)
    if [type(i) for i in cell.instruments] != [Tracker]:
        return hidden, placed.markers, ""  # what others read is no point of the arm
    if isinstance(plan, Measurements):
        return _unread(plan, hidden), _in_base(cell, plan, placed.markers), "measured"
    return hidden, placed.markers, "" if cell.instrument is None else "in sight"


def _capsules(placed: Scene, number: list[int]) -> tuple[Body, ...]:
    pairs = zip(number[::2], number[1::2], placed.capsules, strict=True)
    return tuple(Body(a, b, max(1, round(c.radius * 1e3))) for a, b, c in pairs)


def _links(chain: tuple[int, ...], radius: float) -> tuple[Body, ...]:
    return tuple(Body(a, b, max(1, round(radius))) for a, b in pairwise(chain))


def shared(points: IntArray) -> tuple[IntArray, IntArray, int]:
    """Distinct points of (m, k, 3), the still ones first; the number of each; how many are still."""
    flat = points.swapaxes(0, 1).reshape(points.shape[1], -1)
    _, first, number = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    moves = (points[:, first] != points[:1, first]).any(axis=(0, 2))
    order = np.lexsort([first, moves])
    place = np.argsort(order)
    return points[:, first[order]], place[number.reshape(-1)], int((~moves).sum())


def _unread(data: Measurements, hidden: dict[tuple[int, int], str]) -> dict[tuple[int, int], str]:
    """Why a marker has no reading, as far as the cell knows."""
    found = {}
    for i, j in np.argwhere(~data.seen):
        why = hidden.get((int(i), int(j)))
        found[int(i), int(j)] = "not measured" if why is None else f"not measured ({why})"
    return found


def _in_base(cell: Cell, data: Measurements, nominal: Array) -> Array:
    """Measured markers in the base frame, shape (m, M, 3), m; the nominal ones where none was read."""
    placing = tuple(e for e in cell.effects if parse_effect(e)[0] in ("base", "tool"))
    if not any(parse_effect(e)[0] == "base" for e in placing):
        return np.where(data.seen[:, :, None], data.points, nominal)
    model = build(replace(cell, effects=placing), data.poses).model
    R, p = model.placement(initial_values(model, data), data.poses)
    points = rotate(R.swapaxes(-1, -2)[:, None], data.points - p[:, None])
    return np.where(data.seen[:, :, None], points, nominal)


def _shown(value: float) -> str:
    return f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
