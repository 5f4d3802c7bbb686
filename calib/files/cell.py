"""Read ``cell.toml``: its checked tables, and the files that it names, as a cell."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import cast

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import transformed
from calib.arm.statics import Payload
from calib.arm.ties import Coupling, moves_itself
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import MotionKeys, Planned, Targets
from calib.cell.tables import CellFile, CouplingTable
from calib.errors import InputError, UnknownEffect
from calib.files.cell_table import cell_table
from calib.files.robot import load_robot
from calib.files.tables import load_targets
from calib.instruments import CellParts, Instrument
from calib.instruments.board import BoardTable
from calib.instruments.protocol import TIP, WORLD
from calib.instruments.riding import corners_of
from calib.instruments.socket import joined_sockets
from calib.keys import DEG, MM
from calib.model.build import context_of, parse_effect, parse_excluded
from calib.motion.effects import parted

_UNKNOWN = 3 * (np.nan,)
_LARGEST_BOARD = 50.0  # m
_ROUNDED = 1e-9  # rad or m
_CORNERS = corners_of(np.eye(3), np.zeros(3))


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table = cell_table(path)
    robot = _robot(path, table)
    try:
        of_poses, of_motions = parted(table.model.effects, table.robot.anchors)
        for text in of_poses:
            parse_effect(text)
    except UnknownEffect as error:
        raise InputError(path, "model.effects", str(error)) from None
    not_poses, not_motions = parted(table.diagnosis.exclude, table.robot.anchors)
    shapes = {name: _shape(path, name, board) for name, board in table.boards.items()}
    bodies, seats = _bodies(table, shapes), _seats(table)
    slices = _slices(len(table.markers_mm), (*bodies.values(), *seats.values()))
    parts = dict(zip(bodies, slices, strict=False))
    seated = dict(zip(seats, slices[len(bodies) :], strict=True))
    beside = [(name, point, table.link(on), None, None)
              for names, points, on in (*bodies.values(), *seats.values())
              for name, point in zip(names, points, strict=True)]  # fmt: skip
    single = [(name, marker.position, table.link(marker.on), marker.normal, marker.acceptance)
              for name, marker in table.markers_mm.items()]  # fmt: skip
    names, points, links, normals, accepted = (
        zip(*single, *beside, strict=True) if [*single, *beside] else ((),) * 5
    )
    facing = np.array([_UNKNOWN if n is None else n for n in normals]).reshape(-1, 3)
    cell = Cell(
        robot,
        np.array(points).reshape(-1, 3),
        _instruments(path, table, shapes, parts, seated),
        of_poses,
        name=table.name or path.stem,
        path=path,
        marker_names=names,
        marker_normals=facing / np.linalg.norm(facing, axis=1, keepdims=True),
        marker_acceptance=np.array([np.nan if angle is None else angle for angle in accepted]),
        marker_links=links if table.links else (),
        gravity=np.array(table.gravity.m_s2),
        payload=Payload(table.payload.mass, table.payload.com, _frame(robot, table.payload.on)),
        load=table.load,
        knots=table.model.knots,
        anchors=table.robot.anchors,
        shapes=robot.shapes if table.robot.shapes is None else table.robot.shapes,
        design=planned(path, robot, replace(table.design, targets=None)),
        pace=table.timing,
        repeatability=table.robot.repeatability,
        gear_ratios=table.robot.gear_ratios,
        known_distances=tuple(table.known_distances),
        bodies=parts,
        seats=seated,
        tolerance=table.acceptance and table.acceptance.tolerance,
        size_prior=table.model.size_prior,
        about=table.report,
        motion=MotionKeys(
            table.motion.cutoff,
            table.robot.torque_constants,
            of_motions,
            not_motions,
        ),
    )
    cell = replace(cell, excluded=_excluded(cell, not_poses))
    return with_targets(cell, cast("str | None", table.design.targets))


def _excluded(cell: Cell, causes: Sequence[str]) -> tuple[str, ...]:
    """Names of causes, each with its place. Raises InputError."""
    try:
        context = context_of(cell, None)
        return tuple(cause for name in causes for cause in parse_excluded(name, context))
    except UnknownEffect as error:
        raise InputError(cell.path, "diagnosis.exclude", str(error)) from None


def with_targets(cell: Cell, file: str | None) -> Cell:
    """The cell with the targets of a file beside it. Raises InputError."""
    if file is None:
        return cell
    path = cell.path.parent / file
    targets = Targets(path, *load_targets(cell, path))
    return replace(cell, design=replace(cell.design, targets=targets))


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


# -- what rides on links beside the markers --------------------------------------------------------

_Points = tuple[tuple[str, ...], Array]
"""Names of points, and these (n, 3), m."""
_Riding = tuple[tuple[str, ...], Array, str]
"""The same, and the link on which they ride."""


def _shape(path: Path, name: str, board: BoardTable) -> _Points:
    """Points of a board; one that lies where no board reaches is none of it. Raises InputError."""
    names, points = board.shape()
    near = np.abs(points - np.median(points, axis=0)).max(axis=1) < _LARGEST_BOARD
    if not near.any():
        what = "lie farther apart than those of any board"
        raise InputError(path, f"boards.{name}.points_mm", what, "give them in mm")
    return tuple(f"{name}:{point}" for point in itertools.compress(names, near)), points[near]


def _bodies(table: CellFile, shapes: Mapping[str, _Points]) -> dict[str, _Riding]:
    """Frames and cameras on links, then boards; one of which nothing is said is at its link's frame."""
    framed = {**table.bodies, **table.carried}.items()
    bodies: dict[str, _Riding] = {
        name: ((name, f"{name}:x", f"{name}:y"), transformed(body.frame, _CORNERS), body.on)
        for name, body in framed
    }
    for name, board in table.boards.items():
        if board.on != WORLD:
            names, points = shapes[name]
            bodies[name] = names, transformed(board.frame, points), board.on
    return bodies


def _seats(table: CellFile) -> dict[str, _Riding]:
    """Links under instruments, by name."""
    under = {table.link(i.on): i.on for i in table.seated.values()}
    return {k: (tuple(f"{k}:{end}" for end in "oxy"), _CORNERS, on) for k, on in under.items()}


def _slices(first: int, riding: Iterable[_Riding]) -> list[slice]:
    """Positions of points that follow each other."""
    counts = np.cumsum([first, *(len(names) for names, *_ in riding)]).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(counts)]


def _instruments(
    path: Path,
    table: CellFile,
    shapes: Mapping[str, _Points],
    parts: Mapping[str, slice],
    seats: Mapping[str, slice],
) -> tuple[Instrument, ...]:
    """All of them; sockets of one uncertainty are one instrument that stands elsewhere each time.

    Raises InputError for one on a link that carries all that it could read, and for a camera where
    OpenCV is not installed.
    """
    if table.instrument is not None:
        return (table.instrument.tracker(),)
    for name in table.cameras if find_spec("cv2") is None else ():
        what = "is a camera, which needs OpenCV"
        raise InputError(path, f"instruments.{name}", what, "pip install '.[camera]'")
    cell = CellParts(
        links=tuple(marker.on for marker in table.markers_mm.values()),
        parts={**parts, **seats},
        read_as_poses={name: body.on for name, body in table.bodies.items()},
        boards={name: (table.boards[name], *shape) for name, shape in shapes.items()},
        placed="base" in table.model.effects,
    )
    made = {name: keys.instrument(name, cell) for name, keys in table.instruments.items()}
    for name, keys in table.seated.items():
        if made[name].markers == ():
            what = f"rides on {keys.on} as all does that it reads"
            raise InputError(path, f"instruments.{name}.on", what, "name another link")
        made[name] = replace(made[name], seat=seats[table.link(keys.on)])
    return joined_sockets([*made.values()])


# -- the robot -------------------------------------------------------------------------------------


def _robot(path: Path, table: CellFile) -> Robot:
    """The robot that a cell names, narrowed, coupled and driven as it says. Raises InputError."""
    keys = table.robot
    file = path.parent / keys.file
    robot = load_robot(keys.form, file, keys.base, keys.tip, keys.dh_convention, table.links)
    _check_joints(path, robot, table)
    robot = coupled(path, robot, keys.coupled)
    if table.load is not None:
        robot = replace(robot, loaded=_frame(robot, table.load.on))
    limits, unknown = robot.limits.copy(), np.full(robot.dof, np.nan)
    speeds, accelerations = (
        unknown.copy() if given is None else given.copy()
        for given in (robot.speeds, robot.accelerations)
    )
    for slides, key, scale, values in keys.of_joints():
        for joint, value in values.items():
            j, where = robot.joints.index(joint), f"robot.{key}.{joint}"
            if robot.prismatic[j] != slides:
                what = f"joint {joint} {'turns' if slides else 'slides'}: this is in another unit"
                other = key.replace("_mm", "_deg") if slides else key.replace("_deg", "_mm")
                raise InputError(path, where, what, f"write it under [robot.{other}]")
            if key.startswith("limits"):
                low, high = np.array(value) * scale
                narrowed = max(limits[j, 0], low), min(limits[j, 1], high)
                if narrowed[0] > narrowed[1]:
                    what = f"leaves nothing of the {keys.form.upper()}'s limits"
                    known = "those are {:g} .. {:g}".format(*(limits[j] / scale))
                    raise InputError(path, where, what, known)
                limits[j] = narrowed
            else:
                (speeds if key.startswith("speed") else accelerations)[j] = value * scale
    robot = replace(robot, limits=limits, speeds=speeds, accelerations=accelerations)
    for name, (low, high) in zip(robot.joints, robot.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            what = f"limits leave nothing to {name}, which moves with others"
            raise InputError(path, "robot", what, "widen those in the cell or robot's file")
    return robot


def _frame(robot: Robot, on: str) -> int:
    """Frame of the tip that is named so."""
    return -1 if on == TIP else robot.dof + 1 + robot.tips.index(on)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    """Refuse keys that name no joint, and knots of a joint that slides."""
    keys = table.robot
    named: dict[str, Iterable[str]] = {f"robot.{key}": v for _, key, _, v in keys.of_joints()}
    named |= {
        "robot.compensators_mm": keys.anchors,
        "robot.gear_ratio": keys.gear_ratios,
        "robot.coupled": keys.coupled,
        "robot.capsules_mm": {*(keys.capsules or ())} - {"base", "tool"},
        "design.levels": table.design.levels,
        "model.knots_deg": table.model.knots,
    }
    for key, names in named.items():
        for name in names:
            if name not in robot.joints:
                known = f"joints are {', '.join(robot.joints)}"
                raise InputError(path, f"{key}.{name}", "no such joint", known)
    for joint in table.model.knots:
        if robot.prismatic[robot.joints.index(joint)]:
            raise InputError(path, f"model.knots_deg.{joint}", "is a joint that slides, not turns")


def coupled(path: Path, robot: Robot, table: Mapping[str, CouplingTable]) -> Robot:
    """The robot with its joints coupled as a cell says.

    Raises InputError for a joint that follows another already, for what moves itself, also by way of
    others, and for an offset in another unit.
    """
    couplings = [*robot.couplings]
    for joint, keys in table.items():
        where = f"robot.coupled.{joint}"
        if joint in robot.undriven:
            what = "the robot's file has it mimic another joint"
            raise InputError(path, where, what, "take one of them out")
        for other, factor in keys.of.items():
            if other not in robot.joints or not factor:
                what = f"'of' names {other!r} with {factor:g}, which moves nothing"
                known = f"name joints that move it: {', '.join(robot.joints)}"
                raise InputError(path, where, what, known)
        slides = bool(robot.prismatic[robot.joints.index(joint)])
        if keys.offset_deg if slides else keys.offset_mm:
            key, does = ("offset_mm", "slides") if slides else ("offset_deg", "turns")
            raise InputError(path, where, f"the joint {does}", f"give {key}")
        offset = keys.offset_mm * MM if slides else keys.offset_deg * DEG
        couplings.append(Coupling(joint, tuple(keys.of.items()), offset))
    if joint := moves_itself(couplings):
        what = "moves itself, by way of what moves it"
        raise InputError(path, f"robot.coupled.{joint}", what, "let one of these move freely")
    return replace(robot, couplings=tuple(couplings))
