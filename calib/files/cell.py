"""Read ``cell.toml``: its checked tables, and the files that it names, as a cell."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from calib.arm.mimic import Coupling
from calib.arm.robot import Robot
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.planned import Planned, Targets
from calib.errors import InputError, UnknownEffect
from calib.files.cell_table import cell_table
from calib.files.instruments import bodies_of, instruments_of, known_distances
from calib.files.robot import load_robot
from calib.files.schema import CellFile, CouplingTable, RobotTable
from calib.files.tables import load_targets
from calib.instruments.protocol import TIP
from calib.keys import DEG, MM
from calib.model.build import context_of, parse_effect, parse_excluded

_UNKNOWN = 3 * (math.nan,)
_ROUNDED = 1e-9  # rad or m


def load_cell(path: str | Path) -> Cell:
    """Read a cell file and the robot's file that it names.

    Raises InputError naming the file, the line or key, and what to do.
    """
    path = Path(path)
    table = cell_table(path)
    robot = _robot(path, table)
    try:
        for text in table.model.effects:
            parse_effect(text)
    except UnknownEffect as error:
        raise InputError(path, "model.effects", str(error)) from None
    bodies, markers = bodies_of(path, table), table.markers_mm
    beside, links = (
        len(bodies.names),
        (*(table.link(m.on) for m in markers.values()), *bodies.links),
    )
    normals = np.array([*(m.normal or _UNKNOWN for m in markers.values()), *beside * [_UNKNOWN]])
    normals = normals.reshape(-1, 3)
    accepted = [*(m.acceptance or math.nan for m in markers.values()), *beside * [math.nan]]
    cell = Cell(
        robot,
        np.concatenate([*(m.position[None] for m in markers.values()), bodies.markers]),
        instruments_of(path, table, bodies),
        table.model.effects,
        name=table.name or path.stem,
        path=path,
        marker_names=(*markers, *bodies.names),
        marker_normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        marker_acceptance=np.array(accepted),
        marker_links=links if table.links else (),
        gravity=np.array(table.gravity.m_s2),
        payload=Payload(table.payload.mass, table.payload.com, _frame(robot, table.payload.on)),
        load=table.load,
        knots=table.model.knots_deg,
        anchors=table.robot.compensators_mm,
        shapes=robot.shapes if table.robot.shapes is None else table.robot.shapes,
        design=planned(path, robot, replace(table.design, targets=None)),
        pace=table.timing,
        repeatability=table.robot.repeatability,
        gear_ratios=table.robot.gear_ratio,
        known_distances=known_distances(path, table),
        bodies=bodies.parts,
        seats=bodies.seats,
        tolerance=table.acceptance and table.acceptance.tolerance_mm,
        size_prior=table.model.size_prior,
        about=table.report,
    )
    cell = replace(cell, excluded=_excluded(cell, table.diagnosis.exclude))
    return with_targets(cell, cast("str | None", table.design.targets))


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
    return replace(
        cell, design=replace(cell.design, targets=Targets(path, *load_targets(cell, path)))
    )


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


# -- the robot -----------------------------------------------------------------------------------


def _robot(path: Path, table: CellFile) -> Robot:
    """The robot that a cell names, narrowed, coupled and driven as it says. Raises InputError."""
    own = table.robot
    file = path.parent / own.file
    robot = load_robot(own.form, file, own.base, own.tip, own.dh_convention, table.links)
    _check_joints(path, robot, table)
    robot = coupled(path, robot, own.coupled)
    if table.load is not None:
        robot = replace(robot, loaded=_frame(robot, table.load.on))
    limits, unlimited = robot.limits.copy(), np.full(robot.dof, math.nan)
    drives = {
        what: unlimited.copy() if given is None else given.copy()
        for what, given in (("speed", robot.speeds), ("acceleration", robot.accelerations))
    }
    for what, slides, key, scale, values in own.of_joints():
        for joint, value in values.items():
            j = robot.joints.index(joint)
            if robot.prismatic[j] != slides:
                fault = f"joint {joint} {'turns' if slides else 'slides'}: this is in another unit"
                other = key.replace("_mm", "_deg") if slides else key.replace("_deg", "_mm")
                remedy = f"write it under [robot.{other}]"
                raise InputError(path, f"robot.{key}.{joint}", fault, remedy)
            if what == "limits":
                limits[j] = _narrowed(path, f"robot.{key}.{joint}", own, limits[j], value, scale)
            else:
                drives[what][j] = value * scale
    narrowed = replace(
        robot, limits=limits, speeds=drives["speed"], accelerations=drives["acceleration"]
    )
    for name, (low, high) in zip(robot.joints, narrowed.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            fault = f"limits leave nothing to {name}, which moves with others"
            raise InputError(path, "robot", fault, "widen those in the cell or robot's file")
    return narrowed


def _narrowed(
    path: Path,
    where: str,
    table: RobotTable,
    limits: Array,
    given: tuple[float, float],
    scale: float,
) -> Array:
    """Limits (2,) of a joint within those of the cell, too. Raises InputError where nothing is left."""
    low, high = np.array(given) * scale
    narrowed = np.array([max(limits[0], low), min(limits[1], high)])
    if narrowed[0] > narrowed[1]:
        what = f"leaves nothing of the {table.form.upper()}'s limits"
        known = "those are {:g} .. {:g}".format(*(limits / scale))
        raise InputError(path, where, what, known)
    return narrowed


def _frame(robot: Robot, on: str) -> int:
    """Frame of the tip that is named so."""
    return -1 if on == TIP else robot.dof + 1 + robot.tips.index(on)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    """Refuse keys that name no joint, and knots of a joint that slides."""
    own = table.robot
    named: dict[str, Iterable[str]] = {f"robot.{key}": v for _, _, key, _, v in own.of_joints()}
    named |= {
        "robot.compensators_mm": own.compensators_mm,
        "robot.gear_ratio": own.gear_ratio,
        "robot.coupled": own.coupled,
        "robot.capsules_mm": {*(own.capsules_mm or ())} - {"base", "tool"},
        "design.levels": table.design.levels,
        "model.knots_deg": table.model.knots_deg,
    }
    for key, names in named.items():
        for name in names:
            if name not in robot.joints:
                known = f"joints are {', '.join(robot.joints)}"
                raise InputError(path, f"{key}.{name}", "no such joint", known)
    for joint in table.model.knots_deg:
        if robot.prismatic[robot.joints.index(joint)]:
            raise InputError(path, f"model.knots_deg.{joint}", "is a joint that slides, not turns")


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
        offset = own.offset_mm * MM if slides else own.offset_deg * DEG
        couplings.append(Coupling(joint, tuple(own.of.items()), offset))
    followed = following | {joint: tuple(own.of) for joint, own in table.items()}
    for joint in table:
        masters = [*followed[joint]]
        for name in masters:  # grows
            masters += [other for other in followed.get(name, ()) if other not in masters]
        if joint in masters:
            what = "moves itself, by way of what moves it"
            raise InputError(path, f"robot.coupled.{joint}", what, "let one of these move freely")
    return replace(robot, couplings=tuple(couplings)) if couplings else robot
