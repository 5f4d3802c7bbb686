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
from calib.effects.protocol import Constant
from calib.effects.tool_base import Base, Tool
from calib.errors import InputError
from calib.files.csv_table import columns_text
from calib.files.robot import load_robot
from calib.files.urdf import read_urdf, urdf_tree
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
    lack = f"is made anew from the {cell.robot.source}: the bare chain, without shapes and moments"
    text = corrected_urdf(target, robot, corrections, markers, root=_bare_chain(robot))
    return Written(text, (f"{lack} of inertia",))


def not_rigid(model: Model) -> list[str]:
    """Effects ``name:where`` of a model that no rigid robot can hold."""
    rigid = (Constant, Base, Tool)
    return [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]


def corrected_urdf(
    source: str | Path,
    robot: Robot,
    corrections: Array,
    markers: Mapping[str, Array],
    links: Mapping[str, str] | None = None,
    root: Element | None = None,
) -> str:
    """The text of a URDF whose joint origins carry the identified geometry.

    source : path of the nominal URDF
    corrections : ndarray, shape (F, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`; that of the base is not part of the robot and is ignored
    markers : dict, name -> ndarray, shape (3,), m, tip frame: written as links ``marker_<name>``
    links : dict, name -> the tip on which a marker rides; all on ``robot.tip`` without
    root : Element, in place of the file's; it is changed

    A tip's displacement goes into the fixed joint that carries it alone, or into the markers on it
    where there is none.
    """
    root = read_urdf(Path(source)) if root is None else root
    chain = urdf_tree(Path(source), root).chain(robot.base, robot.tip, robot.others)
    moved, n = displacement(corrections[1:]), robot.dof
    before = {joint.child: joint for joint in chain}
    passed = {robot.base, *(joint.parent for joint in chain)}
    written = dict(zip((joint for joint in chain if joint.moves), moved[:n], strict=True))
    placed = dict(zip(robot.tips, moved[n:], strict=True))
    for tip, D in placed.items():
        if tip not in passed and not before[tip].moves:
            written[before[tip]], placed[tip] = D, np.eye(4)
    elements = {element.get("name"): element for element in root.findall("joint")}
    for joint, D in written.items():
        _write_origin(elements[joint.name], joint.origin @ D)
    for element in [e for e in root if e.get("name", "").startswith(_MARKER)]:
        root.remove(element)  # of an earlier correction
    for name, position in markers.items():
        on = (links or {}).get(name, robot.tip)
        SubElement(root, "link", name=_MARKER + name)
        there = transform(placed[on][:3, :3], transformed(placed[on], position))
        _joint(root, f"{_MARKER}{name}_mount", "fixed", (on, _MARKER + name), there)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _joint(root: Element, name: str, kind: str, links: tuple[str, str], origin: Array) -> Element:
    """A joint of a type between two links, parent and child, at a transform (4, 4)."""
    joint = SubElement(root, "joint", name=name, type=kind)
    _write_origin(joint, origin)
    SubElement(joint, "parent", link=links[0])
    SubElement(joint, "child", link=links[1])
    return joint


def _write_origin(element: Element, T: Array) -> None:
    """Set the <origin> of a joint or an inertial to a transform of shape (4, 4)."""
    origin = element.find("origin")
    if origin is None:
        origin = SubElement(element, "origin")
    origin.set("xyz", words_of(T[:3, 3]))
    origin.set("rpy", words_of(rpy_from_rotation(T[:3, :3])))


def words_of(values: Array) -> str:
    """Numbers to 15 digits, as URDF attributes hold them."""
    return " ".join(f"{value + 0.0:.15g}" for value in values)  # no -0


def _bare_chain(robot: Robot) -> Element:
    """The nominal chain; the link that joint A moves is named ``A_link``, an effort not given is 0.

    A joint that slides needs limits in a URDF, and has wide ones without.
    """
    root, link = Element("robot", name=robot.name), robot.base
    SubElement(root, "link", name=link)
    for k, name in enumerate(robot.joints):
        slides, limited = robot.prismatic[k], bool(np.isfinite(robot.limits[k]).all())
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        child = _free_name(robot, f"{name}_link")
        joint = _joint(root, name, kind, (link, child), robot.origins[k])
        SubElement(joint, "axis", xyz=words_of(robot.axes[k]))
        effort = f"{np.nan_to_num(robot.efforts[k]):.15g}"
        limit = SubElement(joint, "limit", effort=effort, velocity="0")
        if limited or slides:
            low, high = np.clip(robot.limits[k], -_WIDE, _WIDE)
            limit.attrib |= {"lower": f"{low:.15g}", "upper": f"{high:.15g}"}
        moved, link = SubElement(root, "link", name=child), child
        if robot.masses[k] > 0:
            inertial = SubElement(moved, "inertial")
            _write_origin(inertial, transform(np.eye(3), robot.coms[k]))
            SubElement(inertial, "mass", value=f"{robot.masses[k]:.15g}")
            SubElement(inertial, "inertia", _NO_INERTIA)
    _joint(root, _free_name(robot, "tip_mount"), "fixed", (link, robot.tip), robot.origins[-1])
    SubElement(root, "link", name=robot.tip)
    return root


def _free_name(robot: Robot, name: str) -> str:
    """A name that neither the ends nor the joints of the chain bear."""
    while name in (robot.base, robot.tip, *robot.joints):
        name += "_"
    return name


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


def zero_offsets_csv(robot: Robot, found: ZeroOffsets) -> str:
    """The text of the table, a row a joint.

    ``reads_at_zero`` is what the controller shows where the joint truly is at zero.
    """
    shown = np.where(robot.prismatic, found.offsets * 1e3, np.degrees(found.offsets))
    return columns_text(
        {
            "joint": list(robot.joints),
            "offset": [f"{value + 0.0:.9g}" for value in shown],
            "reads_at_zero": [f"{-value + 0.0:.9g}" for value in shown],
            "unit": ["mm" if slides else "deg" for slides in robot.prismatic],
        }
    )
