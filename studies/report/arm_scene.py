"""What the picture of the arm is drawn from: plain numbers, whole millimetres in the base frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.build import build, parse_effect
from calib.cell import Cell
from calib.errors import CalibError
from calib.identify.initial import initial_values
from calib.poses import IntArray, Measurements, Poses
from calib.se3 import Array, rotate
from doe.constraints import hidden_by, scene_of
from studies.report.surroundings import (
    Outline,
    floor_lines,
    floor_step,
    outlines_of,
    ring,
    whole_mm,
)

_NEAR = 1.6  # arm lengths; what stands farther from the middle is not in the picture
_FOOT = 0.09  # arm lengths
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
    tip_axes : ndarray of int, shape (m, 2, 3), x and y axis of the tip frame, in hundredths
    markers : tuple of str, names; marker_points : tuple of int
    hidden : dict, (pose, marker) -> why it is not in sight, or not measured
    seen : str, what the others are: ``in sight``, ``measured``, or empty where nobody knows
    bodies : tuple of Body; shaped : bool, whether they are the cell's capsules or mere lines
    instrument : ndarray of int, shape (3,), mm, or None; far : bool, too far to be in the picture
    outlines : tuple of Outline, the obstacles
    floor : ndarray of int, shape (l, 2, 3), lines of the plane z = 0, ``step`` mm apart
    foot : ndarray of int, shape (k, 3), a ring on the floor around the base
    bounds : ndarray of int, shape (2, 3), corners of the box that the picture shows
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
    tip_axes: IntArray
    markers: tuple[str, ...]
    marker_points: tuple[int, ...]
    hidden: dict[tuple[int, int], str]
    seen: str
    bodies: tuple[Body, ...]
    shaped: bool
    instrument: IntArray | None
    far: bool
    outlines: tuple[Outline, ...]
    floor: IntArray
    step: int
    foot: IntArray
    bounds: IntArray


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
    hidden, markers = hidden_by(placed), placed.markers
    seen = "" if cell.instrument is None else "in sight"
    if isinstance(plan, Measurements):
        hidden, markers, seen = _unread(plan, hidden), _in_base(cell, plan, markers), "measured"
    ends = [end for c in placed.capsules for end in (c.start, c.end)]
    columns = [*np.moveaxis(placed.origins, 1, 0), *np.moveaxis(markers, 1, 0), *ends]
    points, number, still = _shared(whole_mm(np.stack(columns, axis=1)))
    n, M = robot.dof + 2, len(cell.markers)
    chain = tuple(dict.fromkeys(number[:n]))
    low, high = (f(points[:, chain], axis=(0, 1)) for f in (np.min, np.max))
    length = float(np.linalg.norm(points[:, chain] - points[:, chain[:1]], axis=-1).max())
    radii = [whole_mm(np.array(c.radius)) for c in placed.capsules]
    capsules = zip(number[n + M :: 2], number[n + M + 1 :: 2], radii, strict=True)
    lines = zip(chain[:-1], chain[1:], [_SLIM * length] * (len(chain) - 1), strict=True)
    step = floor_step(length)
    floor = floor_lines(low, high, step)
    instrument = None if cell.instrument is None else whole_mm(cell.instrument)
    outlines = outlines_of(cell, low, high, step)
    frame = np.concatenate([floor.reshape(-1, 3), [low, high]])
    middle, near = (frame.min(axis=0) + frame.max(axis=0)) / 2.0, _NEAR * length
    around = [] if instrument is None else [instrument[None]]
    around += [line for outline in outlines for line in outline.lines]
    for group in around:
        if (np.linalg.norm(group - middle, axis=1) <= near).all():
            frame = np.concatenate([frame, group])
    return ArmScene(
        name=cell.name,
        poses=poses.names,
        joints=robot.joints,
        units=tuple("mm" if slides else "deg" for slides in robot.prismatic),
        values=np.asarray(
            np.where(robot.prismatic, poses.q * 1e3, np.degrees(poses.q)).round(2) + 0.0
        ),
        level=None if level_joint is None else robot.joints.index(level_joint),
        points=points,
        still=still,
        chain=chain,
        tip_axes=np.rint(placed.frames.R[:, -1, :, :2].swapaxes(1, 2) * 100.0).astype(int),
        markers=cell.marker_names,
        marker_points=tuple(number[n : n + M]),
        hidden=hidden,
        seen=seen,
        bodies=tuple(Body(a, b, max(1, int(r))) for a, b, r in (capsules if radii else lines)),
        shaped=bool(radii),
        instrument=instrument,
        far=instrument is not None and bool(np.linalg.norm(instrument - middle) > near),
        outlines=outlines,
        floor=floor,
        step=step,
        foot=ring(_FOOT * length),
        bounds=np.stack([frame.min(axis=0), frame.max(axis=0)]),
    )


def _shared(points: IntArray) -> tuple[IntArray, list[int], int]:
    """Distinct points of (m, k, 3), the still ones first; the number of each; how many are still."""
    flat = points.swapaxes(0, 1).reshape(points.shape[1], -1)
    _, first, number = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    moves = (points[:, first] != points[:1, first]).any(axis=(0, 2))
    order = np.lexsort([first, moves])
    place = np.argsort(order)
    return points[:, first[order]], [int(i) for i in place[number.reshape(-1)]], int((~moves).sum())


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
