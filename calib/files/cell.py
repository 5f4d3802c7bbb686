"""Read ``cell.toml``: its checked tables, and the files that it names, as a cell."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from calib.arm.mimic import Coupling
from calib.arm.robot import Robot, Shapes
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import Planned, Targets
from calib.errors import InputError, UnknownEffect
from calib.files.cell_table import cell_table
from calib.files.instruments import bodies_of, instruments_of, known_distances
from calib.files.robot import load_robot
from calib.files.schema import CellFile, CouplingTable, MarkerTable, RobotTable
from calib.files.tables import load_targets
from calib.instruments.protocol import TIP
from calib.keys import DEG, MM
from calib.model.build import context_of, parse_effect, parse_excluded

_BLANK = MarkerTable(position=(0.0, 0.0, 0.0))
_ROUNDED = 1e-9  # rad or m
_OF_JOINTS = {"limits": "", "speed": "_s", "acceleration": "_s2"}
"""What [robot] says of joints by keys with a unit, and what follows ``_deg`` or ``_mm`` in these."""


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table = cell_table(path)
    robot = _robot(path, table)
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
        tolerance=tolerance and tolerance.tolerance_mm,
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
    return Payload(table.payload.mass_kg, (x, y, z), _frame(robot, table.payload.on))


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


def _robot(path: Path, table: CellFile) -> Robot:
    """The robot that a cell names, narrowed, coupled and driven as it says. Raises InputError."""
    own = table.robot
    file = path.parent / own.file
    robot = load_robot(own.form, file, own.base, own.tip, own.dh_convention, table.links)
    _check_joints(path, robot, table)
    robot = coupled(path, robot, own.coupled)
    if table.load is not None:
        robot = replace(robot, loaded=_frame(robot, table.load.on))
    drives = {}
    for what, given in (("speed", robot.speeds), ("acceleration", robot.accelerations)):
        drives[what] = np.full(robot.dof, math.nan) if given is None else given.copy()
        for _, joint, value in _of_joints(path, robot, own, what):
            drives[what][joint] = value
    robot = _narrowed(path, robot, own)
    return replace(robot, speeds=drives["speed"], accelerations=drives["acceleration"])


def _frame(robot: Robot, on: str) -> int:
    """Frame of the tip that is named so."""
    return -1 if on == TIP else robot.dof + 1 + robot.tips.index(on)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    """Refuse keys that name no joint, and knots of a joint that slides."""
    own = table.robot
    named: list[tuple[str, Iterable[str]]] = [
        *(
            (f"robot.{key}", getattr(own, key))
            for what in _OF_JOINTS
            for key in _keys(what).values()
        ),
        ("robot.compensators_mm", own.compensators_mm),
        ("robot.gear_ratio", own.gear_ratio),
        ("robot.coupled", own.coupled),
        ("robot.capsules_mm", {*(own.capsules_mm or ())} - {"base", "tool"}),
        ("design.levels", table.design.levels),
        ("model.knots_deg", table.model.knots_deg),
    ]
    for key, names in named:
        for name in names:
            if name not in robot.joints:
                known = f"joints are {', '.join(robot.joints)}"
                raise InputError(path, f"{key}.{name}", "no such joint", known)
    for joint in table.model.knots_deg:
        if robot.prismatic[robot.joints.index(joint)]:
            raise InputError(path, f"model.knots_deg.{joint}", "is a joint that slides, not turns")


def _keys(what: str) -> dict[bool, str]:
    """Keys for joints that turn, and that slide."""
    return {
        slides: f"{what}_{'mm' if slides else 'deg'}{_OF_JOINTS[what]}" for slides in (False, True)
    }


def _of_joints(
    path: Path, robot: Robot, table: RobotTable, what: str
) -> Iterator[tuple[str, int, Array]]:
    """Key, joint and value, SI, of all that is said of single joints."""
    for slides, key in _keys(what).items():
        for joint, value in getattr(table, key).items():
            index = robot.joints.index(joint)
            if robot.prismatic[index] != slides:
                does = "turns" if slides else "slides"
                fault = f"joint {joint} {does}: this is in another unit"
                remedy = f"write it under [robot.{_keys(what)[not slides]}]"
                raise InputError(path, f"robot.{key}.{joint}", fault, remedy)
            yield f"robot.{key}.{joint}", index, np.array(value) * (MM if slides else DEG)


def _narrowed(path: Path, robot: Robot, table: RobotTable) -> Robot:
    """The robot within the limits of the cell, too. Raises InputError where these leave nothing."""
    limits = robot.limits.copy()
    for key, joint, (low, high) in _of_joints(path, robot, table, "limits"):
        limits[joint] = max(limits[joint, 0], low), min(limits[joint, 1], high)
        if limits[joint, 0] > limits[joint, 1]:
            what = f"leaves nothing of the {table.form.upper()}'s limits"
            unit = MM if robot.prismatic[joint] else DEG
            known = "those are {:g} .. {:g}".format(*(robot.limits[joint] / unit))
            raise InputError(path, key, what, known)
    narrowed = replace(robot, limits=limits)
    for name, (low, high) in zip(robot.joints, narrowed.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            what = f"limits leave nothing to {name}, which moves with others"
            raise InputError(path, "robot", what, "widen those in the cell or robot's file")
    return narrowed


def coupled(path: Path, robot: Robot, table: Mapping[str, CouplingTable]) -> Robot:
    """The robot with its joints coupled as a cell says.

    Raises InputError for a joint that follows another already, for what moves itself, also by way of
    others, and for an offset in another unit.
    """
    following = {mimic.joint: (mimic.master,) for mimic in robot.mimics}
    couplings = []
    for joint, own in table.items():
        where = f"robot.coupled.{joint}"
        if joint in following:
            what = f"the robot's file has it mimic {following[joint][0]}"
            raise InputError(path, where, what, "take one of them out")
        for other, factor in own.of.items():
            if other not in robot.joints or not factor:
                what = f"'of' names {other!r} with {factor:g}, which moves nothing"
                known = f"name joints that move it: {', '.join(robot.joints)}"
                raise InputError(path, where, what, known)
        slides = bool(robot.prismatic[robot.joints.index(joint)])
        if own.offset_deg if slides else own.offset_mm:
            key, does = ("offset_mm", "slides") if slides else ("offset_deg", "turns")
            raise InputError(path, where, f"the joint {does}", f"give {key}")
        offset = own.offset_mm * MM if slides else math.radians(own.offset_deg)
        couplings.append(Coupling(joint, tuple(own.of.items()), offset))
    followed = following | {joint: tuple(own.of) for joint, own in table.items()}
    for joint in table:
        if joint in _masters(followed, joint):
            what = "moves itself, by way of what moves it"
            raise InputError(path, f"robot.coupled.{joint}", what, "let one of these move freely")
    return replace(robot, couplings=tuple(couplings)) if couplings else robot


def _masters(followed: Mapping[str, tuple[str, ...]], joint: str) -> set[str]:
    """All that moves a joint, those that move others among them."""
    found: list[str] = [*followed[joint]]
    for name in found:  # grows
        found += [other for other in followed.get(name, ()) if other not in found]
    return set(found)
