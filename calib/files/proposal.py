"""What a robot's file says of a cell: its form, base and tip, its joints, and what it lacks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.robot import Convention, Form, Robot, odd_limits
from calib.arrays import Mask
from calib.errors import InputError
from calib.files.mjcf import compiled
from calib.files.read import read_bytes, read_xml
from calib.files.robot import load_robot
from calib.files.urdf import Urdf

_LARGEST_FILE = 100_000_000  # bytes
_TIPS = ("tool0", "tcp", "tool", "ee", "eef", "end_effector", "attachment", "flange")
_GROUND = re.compile("world|map|odom|ground|footprint")
_OPENS, _TURNS = re.compile("grip|finger|jaw|claw"), re.compile("yaw|roll|pitch|rotat|twist")
"""Names of joints that open and close a gripper, and of those that turn it."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A robot as read.

    held : tuple of str, joints of the file beside and beyond the chain, at zero
    notes : tuple of str, what was chosen; lacks : tuple of str, what the file does not say
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

    convention : of a DH table, which does not state it; base, tip : in place of those proposed
    others : links that are tips beside ``tip``

    Raises InputError.
    """
    head = read_bytes(path, _LARGEST_FILE).removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    notes, moving = tuple[str, ...](), tuple[str, ...]()
    form: Form = "dh"
    if head == b"<":
        if convention is not None:
            raise InputError(path, "", "is no DH table", "leave --dh out")
        root = read_xml(path, "URDF or MJCF")
        form = _form_of(path, root)
        tree = _mjcf_tree(compiled(path)[2]) if form == "mjcf" else _urdf_tree(Urdf(path, root))
        moving = tuple(joint for own in tree.all() for joint in own.joints)
        first, last, chosen = _ends_of(path, tree)
        base, tip, notes = base or first, tip or last, () if tip else chosen
    elif path.suffix.lower() in (".yaml", ".yml"):
        raise InputError(path, "", "is no URDF, MJCF or DH table", "take the maker's URDF")
    elif path.suffix.lower() == ".conf":
        remedy = "take the URDF that the maker's ROS package writes from it"
        raise InputError(path, "", "is a controller's calibration", remedy)
    elif convention is None:
        what = "does not tell the convention of its DH table, which makes another arm of it"
        raise InputError(path, "", what, "add --dh classic or --dh modified")
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
    """What the file does not say, and what to do."""
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


# -- where an arm begins and ends ----------------------------------------------------------------


@dataclass(eq=False)
class _Node:
    """A link, body or site, the joints that move it, and the most joints in a row from here on."""

    name: str
    joints: tuple[str, ...] = ()
    children: list[_Node] = field(default_factory=list)
    longest: int = 0

    def all(self, rigid: bool = False) -> list[_Node]:
        """The node and all that hangs on it, parents first; rigid : without a joint."""
        nodes = [self]
        for node in nodes:  # grows
            nodes += [own for own in node.children if not (rigid and own.joints)]
        return nodes

    def measured(self) -> _Node:
        """Itself, once all that hangs on it knows its longest row."""
        for node in reversed(self.all()):
            node.longest = len(node.joints) + max((c.longest for c in node.children), default=0)
        return self


def _urdf_tree(urdf: Urdf) -> _Node:
    """The first link of the longest row. Raises InputError where links hang in a circle."""
    nodes, hung = {name: _Node(name) for name in urdf.links}, set[str]()
    for joint in urdf.joints.values():
        if {joint.parent, joint.child} <= nodes.keys():
            hung.add(joint.child)
            nodes[joint.parent].children.append(nodes[joint.child])
            nodes[joint.child].joints = (joint.name,) if joint.moves else ()
    roots = [node.measured() for name, node in nodes.items() if name not in hung]
    if not roots:
        remedy = "links must hang on one that hangs on none"
        raise InputError(urdf.path, "", "has no first link", remedy)
    return max(roots, key=lambda node: node.longest)


def _mjcf_tree(model: Any) -> _Node:
    """The world, with bodies and sites."""
    nodes = [_Node(model.body(b).name) for b in range(model.nbody)]
    for j in range(model.njnt):
        nodes[int(model.jnt_bodyid[j])].joints += (model.joint(j).name,)
    for b, node in enumerate(nodes[1:], 1):
        nodes[int(model.body_parentid[b])].children.append(node)
    for s in range(model.nsite):
        nodes[int(model.site_bodyid[s])].children.append(_Node(model.site(s).name))
    return nodes[0].measured()


def _ends_of(path: Path, root: _Node) -> tuple[str, str, tuple[str, ...]]:
    """Base and tip, and what a reader should know of the choice.

    Follow the longest row of joints, past a head or wheels, up to a hand: where several rows part that
    have no more joints than the way to them, these are fingers. A row ends before the first joint that
    is named as one that opens a gripper.

    Raises InputError where no joint moves.
    """
    way, start, taken, notes = [root], 0, 0, list[str]()
    while moving := [child for child in way[-1].children if child.longest]:
        chosen, *others = sorted(moving, key=lambda child: -child.longest)
        if others and chosen.longest <= taken:
            break
        if rivals := [_first_joint(own) for own in others if own.longest == chosen.longest]:
            notes.append(
                f"arms of one length part at {way[-1].name!r}: took that of {_first_joint(chosen)}, "
                f"not of {', '.join(rivals)}; --tip takes another; one --tip for each arm takes all"
            )
        start = len(way) - 1 if others and not taken else start
        way.append(chosen)
        taken += len(chosen.joints)
    row = [node for node in way if node.joints]
    if not row:
        raise InputError(path, "", "has no moving joint", "is it the file of an arm?")
    gripping = [any(map(_opens, node.joints)) for node in row]
    arm = row[: gripping.index(True)] if any(gripping) and not gripping[0] else row
    if left := row[len(arm) :]:
        names = ", ".join(joint for own in left for joint in own.joints)
        within = f". To include it: --tip {left[-1].name}" if left[-1].name else ""
        notes.append(f"{names} moves a gripper and is left out{within}")
    return _base(way[start : way.index(row[0])]), _tip(path, arm[-1]), tuple(notes)


def _first_joint(node: _Node) -> str:
    return next(own.joints[0] for own in node.all() if own.joints) or "?"


def _opens(joint: str) -> bool:
    return bool(_OPENS.search(joint.lower())) and not _TURNS.search(joint.lower())


def _base(before: list[_Node]) -> str:
    names = [node.name for node in before if node.name]
    called = [name for name in names if re.search(r"(^|_)base_link$", name)]
    solid = [name for name in names if not _GROUND.search(name.lower())]
    return (called or solid or names[-1:])[0]


def _tip(path: Path, last: _Node) -> str:
    """What is named like a tool, else the end of the one rigid line."""
    rigid = last.all(rigid=True)
    for word in _TIPS:
        for node in rigid:
            if re.search(rf"(^|[_-]){word}($|[_-])", node.name.lower()):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name
