"""What a robot's file tells of a cell: its form, base and tip, its joints, and what it lacks."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.dh import robot_of_dh
from calib.arm.robot import Convention, Form, Robot, odd_limits
from calib.errors import InputError
from calib.files.dh import dh_text
from calib.files.mjcf import compiled, read_mjcf
from calib.files.read import read_bytes, read_xml
from calib.files.robot import load_robot, robot_files
from calib.files.shapes import urdf_shapes
from calib.files.ur_calibration import read_ur_calibration
from calib.files.urdf import Urdf

_TIPS = ("tool0", "tcp", "tool", "ee", "eef", "end_effector", "attachment", "flange")
_GROUND = ("world", "map", "odom", "ground", "footprint")
_GRIPS = ("gripper", "grip", "finger", "jaw", "claw", "knuckle", "thumb", "hand")
_TURNS = ("wrist", "roll", "yaw", "pitch", "rotat", "twist")  # a gripper that turns is on the arm


@dataclass(eq=False)
class Node:
    """A link, body or site, and the joints that move it against what it hangs on."""

    name: str
    joints: tuple[str, ...]
    children: list[Node] = field(default_factory=list)
    longest: int = 0  # most joints in a row, of this and what hangs on it


@dataclass(frozen=True)
class Ends:
    """Names of base and tip, of every joint that moves, and what a reader should know of the choice."""

    base: str
    tip: str
    moving: tuple[str, ...]
    notes: tuple[str, ...]


def urdf_ends(path: Path, root: Element) -> Ends:
    """Raises InputError where no joint moves, or links hang in a circle."""
    nodes = {e.get("name", ""): Node(e.get("name", ""), ()) for e in root.findall("link")}
    hung = set()
    for joint in Urdf(path, root).joints.values():
        if {joint.parent, joint.child} <= nodes.keys():
            hung.add(joint.child)
            nodes[joint.parent].children.append(nodes[joint.child])
            if joint.moves:
                nodes[joint.child].joints = (joint.name,)
    roots = [node for name, node in nodes.items() if name not in hung]
    for node in roots:
        _measure(node)
    if not roots:
        raise InputError(path, "", "has no first link", "links must hang on one that hangs on none")
    return _ends(path, max(roots, key=lambda node: node.longest))


def mjcf_ends(path: Path) -> Ends:
    """Raises InputError where no joint moves, and for what MuJoCo refuses."""
    read_mjcf(path)  # refuses what is not safe
    model = compiled(path)
    joints = [
        tuple(model.joint(j).name for j in np.flatnonzero(model.jnt_bodyid == b))
        for b in range(model.nbody)
    ]
    nodes = [Node(model.body(b).name, joints[b]) for b in range(model.nbody)]
    for b, node in enumerate(nodes[1:], 1):
        nodes[int(model.body_parentid[b])].children.append(node)
    for s in range(model.nsite):
        nodes[int(model.site_bodyid[s])].children.append(Node(model.site(s).name, ()))
    _measure(nodes[0])
    return _ends(path, nodes[0])


def _all(root: Node) -> list[Node]:
    """The node and all that hangs on it, parents first."""
    found = [root]
    for node in found:  # grows
        found += node.children
    return found


def _measure(root: Node) -> None:
    for node in reversed(_all(root)):
        node.longest = len(node.joints) + max((c.longest for c in node.children), default=0)


def _ends(path: Path, root: Node) -> Ends:
    """Follow the longest row of joints, past a head or wheels, up to a hand.

    Where several rows part, those with no more joints than the way to them are fingers. Of one row the
    joints from the first one that opens a gripper on are left out.
    """
    row: list[Node] = []
    before, notes, node, taken = [root], [], root, 0
    while moving := [child for child in node.children if child.longest]:
        chosen = max(moving, key=lambda child: child.longest)
        if len(moving) > 1 and chosen.longest <= taken:
            break
        rivals = [c for c in moving if c.longest == chosen.longest and c is not chosen]
        if rivals:
            others = ", ".join(_first_moving(c) or "?" for c in rivals)
            notes.append(
                f"arms of one length part at {node.name!r}: took that of {_first_moving(chosen)}, "
                f"not of {others}; --tip takes another; one --tip "
                "for each arm takes all"
            )
        if len(moving) > 1 and not row:
            before = [node]
        node, taken = chosen, taken + len(chosen.joints)
        if node.joints:
            row.append(node)
        elif not row:
            before.append(node)
    if not row:
        raise InputError(path, "", "has no moving joint", "is it the file of an arm?")
    arm = _arm_of(row)
    if gripping := row[len(arm) :]:
        names = ", ".join(joint for own in gripping for joint in own.joints)
        within = f". To include it: --tip {gripping[-1].name}" if gripping[-1].name else ""
        notes.append(f"{names} moves a gripper and is left out{within}")
    every = tuple(joint for own in _all(root) for joint in own.joints)
    return Ends(_base(before), _tip(path, arm[-1]), every, tuple(notes))


def _arm_of(row: list[Node]) -> list[Node]:
    """The nodes that joints of the arm move, without those that open and close a gripper.

    A gripper's joint is named so, or it is the last one and the end effector hangs beside it. The name
    of a link tells nothing: what a wrist turns may well be called a gripper.
    """
    gripping = [any(map(_named_of_gripper, node.joints)) for node in row]
    if any(gripping) and not gripping[0]:
        return row[: gripping.index(True)]
    if len(row) > 1:
        beside = [own for own in _rigid(row[-2]) if row[-1] not in _all(own)]
        if any(_has_word(own.name, word) for own in beside for word in _TIPS):
            return row[:-1]
    return row


def _named_of_gripper(name: str) -> bool:
    """Whether a word of the name, in snake or camel case, is of a gripper that opens.

    >>> [_named_of_gripper(n) for n in ("jointGripper", "moving_jaw_1", "GripperYaw", "handle")]
    [True, True, False, False]
    """
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)
    lower = [word.lower() for word in words]
    turns = any(word.startswith(_TURNS) for word in lower)
    return not turns and any(word.rstrip("s") in _GRIPS for word in lower)


def _has_word(name: str, word: str) -> bool:
    return re.search(rf"(^|[_-]){word}($|[_-])", name.lower()) is not None


def _rigid(node: Node) -> list[Node]:
    """The node and all that hangs on it without a joint, the nearest first."""
    rigid = [node]
    for own in rigid:  # grows
        rigid += [child for child in own.children if not child.joints]
    return rigid


def _first_moving(node: Node) -> str:
    return next((n.joints[0] for n in _all(node) if n.joints), "")


def _base(before: list[Node]) -> str:
    names = [node.name for node in before if node.name]
    for name in names:
        if re.search(r"(^|_)base_link$", name):
            return name
    solid = [name for name in names if not re.search(f"({'|'.join(_GROUND)})", name.lower())]
    return (solid or names[-1:])[0]


def _tip(path: Path, last: Node) -> str:
    """What is named like a tool, else the end of the one rigid line."""
    rigid = _rigid(last)
    for word in _TIPS:
        for node in rigid:
            if _has_word(node.name, word):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name


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
    others: tuple[str, ...] = (),
) -> Proposal:
    """Read a URDF, xacro output, MJCF, DH table or the calibration of a UR, whichever it is.

    convention : of a DH table, which does not tell it; base, tip : in place of those proposed
    model : of the arm that a ``calibration.conf`` of Universal Robots belongs to
    others : links that are tips beside ``tip``

    Raises InputError.
    """
    head = read_bytes(path, _LARGEST_FILE).removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    kind = path.suffix.lower()
    if kind in (".yaml", ".yml") and head != b"<":
        raise InputError(path, "", "is no URDF, MJCF or DH table", "take the maker's URDF")
    tabular = head != b"<" and kind != ".conf"
    if not tabular and convention is not None:
        raise InputError(path, "", "is no DH table", "leave --dh out")
    if kind == ".conf" and head != b"<":
        return _of_calibration(path, base, tip, model, others)
    notes: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    form: Form = "dh"
    if tabular and convention is None:
        what = "does not tell the convention of its DH table, which makes another arm of it"
        raise InputError(path, "", what, "add --dh classic or --dh modified")
    if head == b"<":
        form, ends = _of_xml(path)
        notes, moving = () if tip else ends.notes, ends.moving
        base, tip = base or ends.base, tip or ends.tip
    robot = load_robot(form, path, base, tip, convention, others)
    held = tuple(joint for joint in moving if joint not in (*robot.joints, *robot.told))
    notes += tuple(f"{m.joint} follows {m.master}, which the table tells" for m in robot.mimics)
    lacks = _lacks(form, robot)
    if form == "urdf":
        lacks += _absent(urdf_shapes(path, base, tip, others).unread)
    return Proposal(form, convention, robot_files(form, path), robot, held, "", notes, lacks)


def _of_xml(path: Path) -> tuple[Form, Ends]:
    root = read_xml(path, "URDF or MJCF")
    if root.tag == "mujoco":
        return "mjcf", mjcf_ends(path)
    if root.tag != "robot":
        what = "is neither a URDF (<robot>) nor an MJCF (<mujoco>)"
        raise InputError(path, f"<{str(root.tag)[:40]}>", what)
    tags = [e.tag for e in root.iter() if isinstance(e.tag, str)]
    expressions = any("${" in value for e in root.iter() for value in e.attrib.values())
    if expressions or any(tag.startswith("{") and "xacro" in tag for tag in tags):
        what = "is a xacro file, which makes a URDF but is none"
        raise InputError(path, "", what, f"expand it first: xacro {path.name} > robot.urdf")
    return "urdf", urdf_ends(path, root)


def _of_calibration(
    path: Path, base: str, tip: str, model: str, others: tuple[str, ...]
) -> Proposal:
    if others:
        raise InputError(path, "", f"has one tip, and {others[0]!r} is another", "give one --tip")
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
    source = {"urdf": "URDF", "mjcf": "MJCF", "dh": "DH table"}[form]
    open_ended = ~np.isfinite(robot.limits).all(axis=1)
    if open_ended.any():
        names = ", ".join(np.array(robot.joints)[open_ended])
        planned = "poses are planned within +-180 deg (+-1 m)"
        remedy = "give them in [robot.limits_deg] (or limits_mm)"
        lacks.append(f"no limits of {names} in the {source}: {planned}; {remedy}")
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
