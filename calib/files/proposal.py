"""What a robot's file tells of a cell: its form, base and tip, its joints, and what it lacks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.robot import Convention, Form, Robot, odd_limits
from calib.arrays import Mask
from calib.errors import InputError
from calib.files.ends import ends_of, mjcf_tree, urdf_tree
from calib.files.mjcf import compiled
from calib.files.read import read_bytes, read_xml
from calib.files.robot import load_robot
from calib.files.urdf import Urdf

_LARGEST_FILE = 100_000_000  # bytes


@dataclass(frozen=True, eq=False)
class Proposal:
    """A robot as found.

    held : tuple of str, joints of the file beside and beyond the chain, at zero
    notes : tuple of str, what was chosen; lacks : tuple of str, what the file does not tell
    """

    robot: Robot
    held: tuple[str, ...]
    notes: tuple[str, ...]
    lacks: tuple[str, ...]

    @property
    def form(self) -> Form:
        """Of the robot's file."""
        return self.robot.source.form

    @property
    def files(self) -> tuple[Path, ...]:
        """The robot's file and what it includes."""
        return self.robot.source.files


def propose(
    path: Path,
    convention: Convention | None = None,
    base: str = "",
    tip: str = "",
    others: tuple[str, ...] = (),
) -> Proposal:
    """Read a URDF, xacro output, MJCF or DH table, whichever it is.

    convention : of a DH table, which does not tell it; base, tip : in place of those proposed
    others : links that are tips beside ``tip``

    Raises InputError.
    """
    head = read_bytes(path, _LARGEST_FILE).removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    kind = "" if head == b"<" else path.suffix.lower()
    if kind in (".yaml", ".yml"):
        raise InputError(path, "", "is no URDF, MJCF or DH table", "take the maker's URDF")
    if convention is not None and head == b"<":
        raise InputError(path, "", "is no DH table", "leave --dh out")
    if kind == ".conf":
        remedy = "take the URDF that the maker's ROS package writes from it"
        raise InputError(path, "", "is a controller's calibration", remedy)
    if convention is None and head != b"<":
        what = "does not tell the convention of its DH table, which makes another arm of it"
        raise InputError(path, "", what, "add --dh classic or --dh modified")
    notes: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    form: Form = "dh"
    if head == b"<":
        root = read_xml(path, "URDF or MJCF")
        form = _form_of(path, root)
        tree = mjcf_tree(compiled(path)[2]) if form == "mjcf" else urdf_tree(Urdf(path, root))
        moving = tuple(joint for own in tree.all() for joint in own.joints)
        first, last, chosen = ends_of(path, tree)
        base, tip, notes = base or first, tip or last, () if tip else chosen
    robot = load_robot(form, path, base, tip, convention, others)
    held = tuple(joint for joint in moving if joint not in (*robot.joints, *robot.told))
    notes += tuple(f"{m.joint} follows {m.master}, which the table tells" for m in robot.mimics)
    return Proposal(robot, held, notes, tuple(_lacks(robot)))


def _form_of(path: Path, root: Element) -> Form:
    if root.tag == "mujoco":
        return "mjcf"
    if root.tag != "robot":
        what = "is neither a URDF (<robot>) nor an MJCF (<mujoco>)"
        raise InputError(path, f"<{str(root.tag)[:40]}>", what)
    tags = [e.tag for e in root.iter() if isinstance(e.tag, str)]
    expressions = any("${" in value for e in root.iter() for value in e.attrib.values())
    if expressions or any(tag.startswith("{") and "xacro" in tag for tag in tags):
        what = "is a xacro file, which makes a URDF but is none"
        raise InputError(path, "", what, f"expand it first: xacro {path.name} > robot.urdf")
    return "urdf"


def _lacks(robot: Robot) -> Iterator[str]:
    """What the file does not tell, and what to do."""
    source = str(robot.source)

    def named(chosen: Mask) -> str:
        return ", ".join(np.array(robot.joints)[chosen])

    if open_ended := named(np.asarray(np.isinf(robot.limits).any(axis=1))):
        planned = "poses are planned within +-180 deg (+-1 m)"
        remedy = "give them in [robot.limits_deg] (or limits_mm)"
        yield f"no limits of {open_ended} in the {source}: {planned}; {remedy}"
    yield from odd_limits(robot)
    if still := named(np.asarray(robot.limits[:, 0] == robot.limits[:, 1])):
        yield f"no range of {still}: lower and upper limit are the same; mend the {source}"
    if not robot.masses.any():
        yield (
            f"no link masses in the {source}: the arm's own weight bends nothing in the model; a load, "
            "wrench or payload still does, and gravity_sag finds sag without masses"
        )
    elif light := named(~robot.masses.astype(bool)):
        yield f"no mass beyond {light} in the {source}: its weight counts as none"
    if unread := robot.shapes.unread if robot.source.form == "urdf" else ():
        more = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
        yield (
            f"no shape of {unread[0]}{more}: no collision is checked there; put the meshes "
            "where the URDF says, or give [robot.capsules_mm]"
        )
