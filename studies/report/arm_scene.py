"""What the picture of the arm is drawn from: plain numbers, whole millimetres in the base frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import CalibError
from calib.instruments import Socket, Tracker
from calib.model.build import parse_effect
from calib.poses import Measurements, Poses
from doe.constraints import Scene, hidden_by, scene_of
from studies.report.arm_instruments import fixtures, instrument_places, on_tips, started, within
from studies.report.surroundings import ArmSurroundings, SceneObject, surroundings, whole_mm

_SIGNS = {"deg": "\N{DEGREE SIGN}", "mm": " mm"}
_CARRIED = 0.5  # of the reach with what it carries, an arm's length at least
_NAMES = 3  # that are named one by one
_SLIM = 0.016  # arm lengths; radius of a link where the cell gives the arm no shape


@dataclass(frozen=True, eq=False)
class ArmBody:
    """A piece of the arm: the ends of its axis, shape (m, 2, 3), and its radius, mm."""

    ends: IntArray
    radius: int


@dataclass(frozen=True, eq=False)
class ArmScene:
    """The arm at m poses.

    name : str, of the cell
    poses : tuple of str, identifiers
    joints, units : tuple of str, names, and ``deg`` or ``mm``
    values : ndarray, shape (m, n), joint values in these units
    chain : ndarray of int, shape (m, k, 3), mm, from the base over the joints to the tip; what stands
        at one place at all poses is one point
    branches : dict, link -> the same, to another tip, from where the way to it parts from those before
    tip_axes : ndarray, shape (m, 3, 3), axes of the tip frame, one a row
    markers : tuple of str, names; marker_points : ndarray of int, shape (m, M, 3), mm
    stems : ndarray of int, shape (m, M, 3), mm, the tips on which they ride
    hidden : dict, (pose, marker) -> why it is not in sight, or not measured
    seen : str, what the others are: ``in sight``, ``measured``, or empty where nobody knows
    bodies : tuple of ArmBody; shaped : bool, whether they are the cell's capsules or mere links
    around : ArmSurroundings
    fixtures : tuple of SceneObject, other instruments, boards and what is touched
    beyond : dict, name -> float, m from the base, of those that stand too far off to be drawn
    reads : tuple of str, what other instruments than a tracker read at each pose, in words, or none
    """

    name: str
    poses: tuple[str, ...]
    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    chain: IntArray
    tip_axes: Array
    markers: tuple[str, ...]
    marker_points: IntArray
    stems: IntArray
    hidden: dict[tuple[int, int], str]
    seen: str
    bodies: tuple[ArmBody, ...]
    shaped: bool
    around: ArmSurroundings
    fixtures: tuple[SceneObject, ...] = ()
    beyond: Mapping[str, float] = field(default_factory=dict)
    reads: tuple[str, ...] = ()
    branches: Mapping[str, IntArray] = field(default_factory=dict)

    def readout(self, pose: int) -> tuple[str, str]:
        """Joint values and markers of a pose in words."""
        row = zip(self.joints, self.values[pose], self.units, strict=True)
        shown = [(name, f"{value:.2f}{_SIGNS[unit]}") for name, value, unit in row]
        joints = [f"{name} {value}".replace(" -", " \N{MINUS SIGN}") for name, value in shown]
        lost = self.lost(pose)
        seen = [name for j, name in enumerate(self.markers) if j not in lost]
        words = f"marker{'s'[: len(seen) > 1]} {', '.join(seen)}" if seen else "no marker"
        hidden = [f"{self.markers[j]} {self.hidden[pose, j]}" for j in lost]
        told = [f"{words} {self.seen}".rstrip(), *hidden] if self.markers else []
        told = [self.reads[pose] or "nothing read"] if self.reads else told
        return " \N{MIDDLE DOT} ".join(joints), "; ".join(told)

    def lost(self, pose: int) -> tuple[int, ...]:
        """Markers that are not in sight, or not measured, at a pose."""
        return tuple(j for j in range(len(self.markers)) if (pose, j) in self.hidden)


def scene(cell: Cell, plan: Poses | Measurements) -> ArmScene:
    """The arm of a cell at the poses of a plan, or at measured poses with their measured markers.

    Nominal arm. Which markers of a plan are hidden is what :func:`doe.constraints.hidden_by` says;
    measured ones are those with a reading, brought into the base frame by the placement from which
    an identification starts.

    Raises CalibError where there is no pose.
    """
    poses = plan.poses if isinstance(plan, Measurements) else plan
    robot = cell.robot
    if not len(poses):
        raise CalibError("there is no pose to draw")
    placed, own = scene_of(cell, poses.q), list(cell.single_markers)
    hidden, markers, seen = _markers(cell, plan, placed)
    found = instrument_places(cell, plan)
    ridden = np.zeros((len(poses), 0, 3))
    if not _of_tracker(cell):
        hidden, markers = {}, on_tips(placed, found.markers[own], cell.marker_frames[own])
        # Of a frame its origin alone: markers and points of boards.
        at = [j for j, name in enumerate(cell.marker_names) if not name.endswith((":x", ":y"))]
        ridden = on_tips(placed, found.markers[at], cell.marker_frames[at])
    chain, branches = _ways(placed)
    reached = np.concatenate([chain, *branches.values(), whole_mm(ridden)], axis=1)
    length = _length(chain, reached)
    values = np.where(robot.prismatic, poses.q * 1e3, np.degrees(poses.q))
    around = surroundings(cell, reached.reshape(-1, 3), length)
    drawn = () if _of_tracker(cell) else tuple(fixtures(cell, plan, placed, found, length / 1e3))
    kept, beyond, frame = within(drawn, around.frame, length)
    return ArmScene(
        name=cell.name,
        poses=poses.names,
        joints=robot.joints,
        units=tuple("mm" if slides else "deg" for slides in robot.prismatic),
        values=np.asarray(values.round(2) + 0.0),
        chain=chain,
        tip_axes=placed.frames.R[:, -1].swapaxes(1, 2),
        markers=tuple(cell.marker_names[j] for j in own),
        marker_points=whole_mm(markers),
        stems=whole_mm(placed.origins[:, cell.marker_frames[own]]),
        hidden=hidden,
        seen=seen,
        bodies=_bodies(placed, (chain, *branches.values()), _SLIM * length),
        shaped=bool(placed.capsules),
        around=replace(around, frame=frame),
        fixtures=kept,
        beyond=beyond,
        reads=_reads(cell, plan),
        branches=branches,
    )


def _ways(placed: Scene) -> tuple[IntArray, dict[str, IntArray]]:
    """The way from the base to the tip, and to each other tip from where it parts, mm."""
    robot, branches = placed.cell.robot, dict[str, IntArray]()
    drawn = robot.carries[:, robot.tip_frame].copy()
    chain = _once(whole_mm(placed.origins[:, drawn]))
    for frame, link in enumerate(robot.others, robot.dof + 1):
        way = robot.carries[:, frame]
        parts = int(np.flatnonzero(way & drawn)[-1])
        own = [parts, *np.flatnonzero(way & ~drawn).tolist()]
        branches[link] = _once(whole_mm(placed.origins[:, own]))
        drawn |= way
    return chain, branches


def _once(points: IntArray) -> IntArray:
    """Points (m, k, 3) without those that stand where the one before stands, at all poses."""
    moved = (points[:, 1:] != points[:, :-1]).any(axis=(0, 2))
    return points[:, np.concatenate([[True], moved])]


def _length(arms: IntArray, reached: IntArray) -> float:
    """How far the arm reaches from its base, mm; if its axes meet in a point, what it carries."""
    own, most = (
        float(np.linalg.norm(points - arms[:, :1], axis=-1).max()) for points in (arms, reached)
    )
    return max(own, _CARRIED * most)


def _of_tracker(cell: Cell) -> bool:
    return [(type(i), i.seat) for i in cell.instruments] == [(Tracker, None)]


def _reads(cell: Cell, plan: Poses | Measurements) -> tuple[str, ...]:
    """What instruments read at each pose; nothing for a tracker alone, and for a plan."""
    if _of_tracker(cell) or not isinstance(plan, Measurements):
        return ()
    sites = plan.poses.site
    told = []
    for i, row in enumerate(plan.seen):
        words = []
        for instrument, part in cell.channels.blocks:
            if row[part].any():
                name = instrument.name_at("" if sites is None else str(sites[i]))
                read = _named(cell, row, part)
                sits = isinstance(instrument, Socket)
                words.append(f"{read} in {name}" if sits else f"{name} reads {read}")
        told.append("; ".join(words))
    return tuple(told)


def _named(cell: Cell, seen: Mask, part: slice) -> str:
    """The readings of an instrument by name, of many how many."""
    names = [n for n, own in zip(cell.channel_names[part], seen[part], strict=True) if own]
    return ", ".join(names) if len(names) <= _NAMES else f"{len(names)} of {len(seen[part])} points"


def _markers(
    cell: Cell, plan: Poses | Measurements, placed: Scene
) -> tuple[dict[tuple[int, int], str], Array, str]:
    """Why markers are not there, where they are (m, M, 3) m, and what those are that are there."""
    hidden = hidden_by(placed)
    if not _of_tracker(cell):
        return {}, placed.markers, ""  # what others read is no point of the arm
    if isinstance(plan, Measurements):
        return _unread(plan, hidden), _in_base(cell, plan, placed.markers), "measured"
    return hidden, placed.markers, "" if cell.instrument is None else "in sight"


def _bodies(placed: Scene, ways: Sequence[IntArray], slim: float) -> tuple[ArmBody, ...]:
    """The cell's capsules; without them links along the ways, as slim as so many mm."""
    found = [(whole_mm(np.stack([c.start, c.end], 1)), 1e3 * c.radius) for c in placed.capsules]
    if not found:
        found = [(way[:, j : j + 2], slim) for way in ways for j in range(way.shape[1] - 1)]
    return tuple(ArmBody(ends, max(1, round(radius))) for ends, radius in found)


def _unread(data: Measurements, hidden: dict[tuple[int, int], str]) -> dict[tuple[int, int], str]:
    """Why a marker has no reading, as far as the cell knows."""
    found = {}
    for i, j in np.argwhere(~data.seen):
        why = hidden.get((int(i), int(j)))
        found[int(i), int(j)] = "not measured" if why is None else f"not measured ({why})"
    return found


def _in_base(cell: Cell, data: Measurements, nominal: Array) -> Array:
    """Measured markers in the base frame, shape (m, M, 3), m; the nominal ones where none was read."""
    if not any(parse_effect(e)[0] == "base" for e in cell.effects):
        return np.where(data.seen[:, :, None], data.points, nominal)
    model, values = started(cell, data)
    R, p = model.placement(values, data.poses)
    points = rotate(R.swapaxes(-1, -2)[:, None], data.points - p[:, None])
    return np.where(data.seen[:, :, None], points, nominal)
