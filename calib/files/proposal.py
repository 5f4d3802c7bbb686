"""What a robot's file tells of a cell: its form, its ends, its joints, and what it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.dh import robot_of_dh
from calib.arm.odd_limits import odd_limits
from calib.arm.robot import Convention, Form, Robot
from calib.errors import InputError
from calib.files.collision import urdf_shapes
from calib.files.dh import dh_text
from calib.files.ends import Ends, mjcf_ends, urdf_ends
from calib.files.mjcf_tree import read_mjcf
from calib.files.read import read_bytes
from calib.files.robot import load_robot, robot_files
from calib.files.ur_calibration import read_ur_calibration
from calib.files.xml import read_xml

_LARGEST_FILE = 100_000_000  # bytes


@dataclass(frozen=True, eq=False)
class Proposal:
    """A robot as found.

    files : tuple of Path, the robot's file and what it includes
    held : tuple of str, joints of the file beside and beyond the chain, at zero
    dh_text : str, a DH table to be written and named by the cell, where the file itself cannot be
    notes : tuple of str, what was chosen; lacks : tuple of str, what the file does not tell
    """

    form: Form
    convention: Convention | None
    files: tuple[Path, ...]
    robot: Robot
    held: tuple[str, ...]
    dh_text: str
    notes: tuple[str, ...]
    lacks: tuple[str, ...]


def propose(
    path: Path,
    convention: Convention | None = None,
    base: str = "",
    tip: str = "",
    model: str = "",
) -> Proposal:
    """Read a URDF, xacro output, MJCF, DH table or a maker's file, whichever it is.

    convention : of a DH table, which does not tell it; base, tip : in place of those proposed
    model : of the arm that a ``calibration.conf`` of Universal Robots belongs to

    Raises InputError.
    """
    head = read_bytes(path, _LARGEST_FILE).removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    kind = path.suffix.lower()
    tabular = head != b"<" and kind not in (".yaml", ".yml", ".conf")
    if not tabular and convention is not None:
        raise InputError(path, "", "is no DH table", "leave --dh out")
    if kind == ".conf" and head != b"<":
        return _of_calibration(path, base, tip, model)
    notes: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    form: Form = "dh" if tabular else "kinematics"
    if tabular and convention is None:
        what = "does not tell the convention of its DH table, which makes another arm of it"
        raise InputError(path, "", what, "add --dh classic or --dh modified")
    if head == b"<":
        form, ends = _of_xml(path)
        notes, moving = () if tip else ends.notes, ends.moving
        base, tip = base or ends.base, tip or ends.tip
    robot = load_robot(form, path, base, tip, convention)
    held = tuple(joint for joint in moving if joint not in (*robot.joints, *robot.told))
    notes += tuple(f"{m.joint} follows {m.master}, which the table tells" for m in robot.mimics)
    lacks = _lacks(form, robot)
    if form == "urdf":
        lacks += _absent(urdf_shapes(path, base, tip).unread)
    return Proposal(form, convention, robot_files(form, path), robot, held, "", notes, lacks)


def _of_xml(path: Path) -> tuple[Form, Ends]:
    root = read_xml(path, "URDF or MJCF")
    if root.tag == "mujoco":
        return "mjcf", mjcf_ends(path, read_mjcf(path)[0])
    if root.tag != "robot":
        what = "is neither a URDF (<robot>) nor an MJCF (<mujoco>)"
        raise InputError(path, f"<{str(root.tag)[:40]}>", what)
    if any(_is_xacro(element) for element in root.iter()):
        what = "is a xacro file, which makes a URDF but is none"
        raise InputError(path, "", what, f"expand it first: xacro {path.name} > robot.urdf")
    return "urdf", urdf_ends(path, root)


def _is_xacro(element: Element) -> bool:
    own = isinstance(element.tag, str) and element.tag.startswith("{") and "xacro" in element.tag
    return own or any("${" in value for value in element.attrib.values())


def _of_calibration(path: Path, base: str, tip: str, model: str) -> Proposal:
    if not model:
        what = "does not tell the model that its numbers are differences to"
        raise InputError(path, "", what, "add --model, such as --model UR5e")
    table = read_ur_calibration(path, model)
    robot = robot_of_dh(table, model, base or "base", tip or "tool0")
    note = (
        "its DH table was written anew, the same arm as the controller's: d stays where the nominal "
        "table has it, and beta (Hayati) holds the tilt of axes 2, 3 and 4"
    )
    lacks = _lacks("dh", robot)
    return Proposal("dh", "classic", (path,), robot, (), dh_text(table), (note,), lacks)


def _absent(unread: tuple[str, ...]) -> tuple[str, ...]:
    """Shapes that cannot be read, which nobody would miss before two links meet."""
    if not unread:
        return ()
    more = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
    return (
        f"no shape of {unread[0]}{more}: no collision is checked there; put the meshes "
        "where the URDF says, or give [robot.capsules_mm]",
    )


def _lacks(form: Form, robot: Robot) -> tuple[str, ...]:
    lacks = []
    source = {"urdf": "URDF", "mjcf": "MJCF", "dh": "DH table"}.get(form, "kinematics file")
    open_ended = ~np.isfinite(robot.limits).all(axis=1)
    if open_ended.any():
        names = ", ".join(np.array(robot.joints)[open_ended])
        lacks.append(
            f"no limits of {names} in the {source}: poses are planned within +-180 deg (+-1 m); give "
            "them in [robot.limits_deg] (or limits_mm)"
        )
    lacks += odd_limits(robot)
    still = robot.limits[:, 0] == robot.limits[:, 1]
    if still.any():
        names = ", ".join(np.array(robot.joints)[still])
        lacks.append(f"no range of {names}: lower and upper limit are the same; mend the {source}")
    if not robot.masses.any():
        lacks.append(
            f"no link masses in the {source}: the arm's own weight bends nothing in the model; a load, "
            "wrench or payload still does, and gravity_sag finds sag without masses"
        )
    elif (robot.masses == 0).any():
        names = ", ".join(np.array(robot.joints)[robot.masses == 0])
        lacks.append(f"no mass beyond {names} in the {source}: its weight counts as none")
    return tuple(lacks)
