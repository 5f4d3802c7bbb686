"""The identified robot as URDF, and as offsets of its joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from calib.arm.kinematics import tip_points
from calib.arm.robot import Robot
from calib.arm.se3 import displacement, fit_rigid, rpy_from_rotation, transform, transformed
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.protocol import Constant
from calib.effects.tool import Tool
from calib.errors import InputError
from calib.files.csv_table import columns_text
from calib.files.robot import load_robot
from calib.files.urdf import Urdf
from calib.model import Model

_MARKER = "marker_"  # how links of markers begin
_WIDE = 1e3  # m
_NO_INERTIA = {f"i{axes}": "0" for axes in ("xx", "xy", "xz", "yy", "yz", "zz")}
_POSES = 128


@dataclass(frozen=True)
class Written:
    """A robot as text, and what it does not hold: each a line about the file."""

    text: str
    lacks: tuple[str, ...]


def corrected_robot(
    cell: Cell, corrections: Array, markers: dict[str, Array], target: Path
) -> Written:
    """The robot with the identified geometry as URDF.

    The user's own URDF is kept but for the corrected numbers. Of an MJCF or a DH table it is the bare
    chain with the limits and masses that there are.

    corrections, markers : as for :func:`corrected_urdf`

    Raises InputError where the file cannot be read any more, and for a tree of another form.
    """
    source, robot = cell.robot_files[0], cell.robot
    if robot.source.form == "urdf":
        on = dict(zip(cell.marker_names, cell.marker_links, strict=False))
        return Written(corrected_urdf(source, robot, corrections, markers, on), ())
    if robot.branched:
        what = f"a URDF made anew has one tip, and this robot has {', '.join(robot.tips)}"
        raise InputError(target, "", what, "name the robot's URDF in the cell")
    if robot.source.form == "mjcf":  # limits as in the file
        robot = load_robot("mjcf", source, robot.base, robot.tip)
    root = Element("robot", name=robot.name)
    _write_chain(root, robot)
    lack = f"is made anew from the {cell.robot.source}: the bare chain, without shapes and moments"
    return Written(
        _corrected(Urdf(target, root), robot, corrections, markers), (f"{lack} of inertia",)
    )


def not_rigid(model: Model) -> list[str]:
    """Effects ``name:where`` of a model that no rigid robot can hold."""
    rigid = (Constant, Base, Tool)
    return [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]


def corrected_urdf(
    source: str | Path,
    robot: Robot,
    corrections: Array,
    markers: dict[str, Array],
    links: Mapping[str, str] | None = None,
) -> str:
    """The text of a URDF whose joint origins carry the identified geometry.

    source : path of the nominal URDF
    corrections : ndarray, shape (F, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`; that of the base is not part of the robot and is ignored
    markers : dict, name -> ndarray, shape (3,), m, tip frame: written as links ``marker_<name>``
    links : dict, name -> the tip on which a marker rides; all on ``robot.tip`` without

    A tip's displacement goes into the fixed joint that carries it alone, or into the markers on it
    where there is none.
    """
    return _corrected(Urdf.read(Path(source)), robot, corrections, markers, links)


def _corrected(
    urdf: Urdf,
    robot: Robot,
    corrections: Array,
    markers: Mapping[str, Array],
    links: Mapping[str, str] | None = None,
) -> str:
    chain = urdf.chain(robot.base, robot.tip, robot.others)
    moved = displacement(corrections[1:])
    before, n = {joint.child: joint for joint in chain}, robot.dof
    passed = {robot.base, *(joint.parent for joint in chain)}
    written = dict(zip((joint for joint in chain if joint.moves), moved[:n], strict=True))
    placed = dict(zip(robot.tips, moved[n:], strict=True))
    for tip, D in placed.items():
        if tip not in passed and not before[tip].moves:
            written[before[tip]], placed[tip] = D, np.eye(4)
    for joint, D in written.items():
        _write_origin(joint.element, urdf.origin_of(joint) @ D)
    on = links or dict.fromkeys(markers, robot.tip)
    _write_markers(urdf.root, {m: (on[m], placed[on[m]], at) for m, at in markers.items()})
    ElementTree.indent(urdf.root)
    return ElementTree.tostring(urdf.root, encoding="unicode", xml_declaration=True) + "\n"


def _write_markers(root: Element, markers: dict[str, tuple[str, Array, Array]]) -> None:
    """Links ``marker_<name>`` on a tip each, at points (3,) behind a transform (4, 4) of the tip."""
    for element in [e for e in root if e.get("name", "").startswith(_MARKER)]:
        root.remove(element)  # of an earlier correction
    for name, (tip, T, position) in markers.items():
        SubElement(root, "link", name=_MARKER + name)
        joint = SubElement(root, "joint", name=f"{_MARKER}{name}_mount", type="fixed")
        _write_origin(joint, transform(T[:3, :3], transformed(T, position)))
        SubElement(joint, "parent", link=tip)
        SubElement(joint, "child", link=_MARKER + name)


def _write_origin(element: Element, T: Array) -> None:
    """Set the <origin> of a joint or an inertial to a transform of shape (4, 4)."""
    origin = element.find("origin")
    if origin is None:
        origin = SubElement(element, "origin")
    origin.set("xyz", _words(T[:3, 3]))
    origin.set("rpy", _words(rpy_from_rotation(T[:3, :3])))


def _words(values: Array) -> str:
    """Numbers to 15 digits, as URDF attributes hold them."""
    return " ".join(f"{value + 0.0:.15g}" for value in values)  # no -0


def _write_chain(root: Element, robot: Robot) -> None:
    """The nominal chain; the link that joint A moves is named ``A_link``, an effort not given is 0."""
    link = robot.base
    SubElement(root, "link", name=link)
    for k, name in enumerate(robot.joints):
        child = _free_name(robot, f"{name}_link")
        joint = _joint(root, name, link, child, robot.origins[k])
        link = child
        SubElement(joint, "axis", xyz=_words(robot.axes[k]))
        _limit(joint, robot, k)
        if robot.masses[k] > 0:
            inertial = SubElement(root[-1], "inertial")
            _write_origin(inertial, transform(np.eye(3), robot.coms[k]))
            SubElement(inertial, "mass", value=f"{robot.masses[k]:.15g}")
            SubElement(inertial, "inertia", _NO_INERTIA)
    mount = _joint(root, _free_name(robot, "tip_mount"), link, robot.tip, robot.origins[-1])
    mount.set("type", "fixed")


def _free_name(robot: Robot, name: str) -> str:
    """A name that neither the ends nor the joints of the chain bear."""
    while name in (robot.base, robot.tip, *robot.joints):
        name += "_"
    return name


def _joint(root: Element, name: str, parent: str, child: str, origin: Array) -> Element:
    """A joint and, after it, the link that it moves."""
    joint = SubElement(root, "joint", name=name)
    _write_origin(joint, origin)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(root, "link", name=child)
    return joint


def _limit(joint: Element, robot: Robot, k: int) -> None:
    """Type and limits; a joint that slides needs limits in a URDF, and has wide ones without."""
    limited = bool(np.isfinite(robot.limits[k]).all())
    kind = "prismatic" if robot.prismatic[k] else "revolute" if limited else "continuous"
    joint.set("type", kind)
    effort = f"{np.nan_to_num(robot.efforts[k]):.15g}"
    limit = SubElement(joint, "limit", effort=effort, velocity="0")
    if limited or robot.prismatic[k]:
        low, high = np.clip(robot.limits[k], -_WIDE, _WIDE)
        limit.set("lower", f"{low:.15g}")
        limit.set("upper", f"{high:.15g}")


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """What of a corrected geometry lies along the joints' own axes.

    offsets : ndarray, shape (n,), rad or m, ``q_true = q_read + offset``
    before, after : float, m, 3-D RMS by which the markers of the nominal arm miss those of the
        corrected one, the base fitted, without and with the offsets
    """

    offsets: Array
    before: float
    after: float


def zero_offsets(robot: Robot, corrections: Array, markers: Array, frames: IntArray) -> ZeroOffsets:
    """The offsets of a geometry, and how much of it they are, over Sobol poses within the limits.

    corrections : ndarray, shape (F, 6), m and rad, as in :class:`~calib.arm.robot.Robot`
    markers : ndarray, shape (M, 3), m, in the frames (M,) of their tips
    """
    own = corrections[1 : robot.dof + 1]
    along = np.where(robot.prismatic[:, None], own[:, :3], own[:, 3:])
    offsets = np.einsum("ki,ki->k", along, robot.axes)
    q = robot.sobol(_POSES)
    true = tip_points(robot, q, markers, corrections, frames)
    missed = []
    for tried in (q, q + offsets):
        points = tip_points(robot, tried, markers, frames=frames)
        off = transformed(fit_rigid(true.reshape(-1, 3), points.reshape(-1, 3)), points) - true
        missed.append(float(np.sqrt(np.mean(np.sum(off**2, axis=-1)))))
    return ZeroOffsets(offsets, *missed)


def zero_offsets_csv(
    robot: Robot, found: ZeroOffsets, counts_per_deg: dict[str, float] | None = None
) -> str:
    """The text of the table, a row a joint.

    ``reads_at_zero`` is what the controller shows where the joint truly is at zero. With encoder counts
    a degree (signed: rising with the joint's angle) ``master_count_change`` is to be added to FANUC's
    ``$MASTER_COUN``, as ``angle = (count - $MASTER_COUN) / counts a degree``.

    Raises InputError for counts of a joint that does not turn, or is not there.
    """
    counts = counts_per_deg or {}
    for name in counts:
        if name not in robot.joints or robot.prismatic[robot.joints.index(name)]:
            turning = [j for j, p in zip(robot.joints, robot.prismatic, strict=True) if not p]
            what = f"no joint {name!r} that turns"
            raise InputError("--counts-per-deg", "", what, f"use {', '.join(turning)}")
    shown = np.where(robot.prismatic, found.offsets * 1e3, np.degrees(found.offsets))
    columns = {
        "joint": list(robot.joints),
        "offset": [f"{value + 0.0:.9g}" for value in shown],
        "reads_at_zero": [f"{-value + 0.0:.9g}" for value in shown],
        "unit": ["mm" if slides else "deg" for slides in robot.prismatic],
    }
    if counts:
        columns["master_count_change"] = [
            f"{-value * counts[joint]:.0f}" if joint in counts else ""
            for joint, value in zip(robot.joints, shown, strict=True)
        ]
    return columns_text(columns)
