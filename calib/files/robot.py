"""The nominal robot of a URDF, MJCF or DH table, and what such a file says of a cell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.robot import Convention, Form, Robot, odd_limits
from calib.errors import InputError
from calib.files.dh import load_dh
from calib.files.mjcf import load_mjcf, mjcf_tree
from calib.files.read import read_bytes, read_xml
from calib.files.tree import Joint, Tree
from calib.files.urdf import load_urdf, urdf_tree

_LARGEST_FILE = 100_000_000  # bytes
_FARTHEST = 50.0  # m: no link is as long
_TIPS = ("tool0", "tcp", "tool", "ee", "eef", "end_effector", "attachment", "flange")
_GROUND = re.compile("world|map|odom|ground|footprint")
_OPENS, _TURNS = re.compile("grip|finger|jaw|claw"), re.compile("yaw|roll|pitch|rotat|twist")
"""Names of joints that open and close a gripper, and of those that turn it."""


def load_robot(
    form: Form,
    path: Path,
    base: str,
    tip: str,
    convention: Convention | None = None,
    others: tuple[str, ...] = (),
) -> Robot:
    """The arm from ``base`` to ``tip`` of a file, with its shapes; a DH table has none.

    convention : of a DH table, whose ends have no names but these words
    others : links that are tips as well, of a URDF or MJCF

    Raises InputError.
    """
    if convention is not None and others:
        what, remedy = f"has one tip, and {others[0]!r} is another", "write the robot as a URDF"
        raise InputError(path, "", what, f"{remedy} or MJCF to have things on several links")
    if convention is not None:
        robot = load_dh(path, convention, base or "base", tip or "tip")
    else:
        robot = (load_mjcf if form == "mjcf" else load_urdf)(path, base, tip, others)
    lengths = np.linalg.norm(robot.origins[:, :3, 3], axis=1)
    for name, length in zip((*robot.joints, *robot.tips), lengths, strict=True):
        if length > _FARTHEST:
            what = f"is {length:.4g} m from the frame before"
            remedy = f"the file counts metres: if these are millimetres, write {length / 1e3:.4g}"
            raise InputError(path, f"origin of {name}", what, remedy)
    return robot


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
    if head != b"<":
        if convention is None:
            what = "is no URDF or MJCF, and a DH table does not tell its convention"
            raise InputError(path, "", what, "add --dh classic or --dh modified")
        robot = load_robot("dh", path, base, tip, convention, others)
        return Proposal(robot, (), (), tuple(_lacks(robot)))
    if convention is not None:
        raise InputError(path, "", "is no DH table", "leave --dh out")
    tree = _tree_of(path)
    first, last, notes = _ends_of(tree)
    robot = load_robot(tree.source.form, path, base or first, tip or last, None, others)
    held = (joint.name for joint in tree.joints if joint.kind != "fixed")
    follow = (f"{own.joint} follows {own.factors[0][0]}" for own in robot.couplings)
    notes = (*(() if tip else notes), *follow)
    return Proposal(
        robot, tuple(j for j in held if j not in robot.joints), notes, tuple(_lacks(robot))
    )


def _tree_of(path: Path) -> Tree:
    root = read_xml(path, "URDF or MJCF")
    if root.tag == "mujoco":
        return mjcf_tree(path)[0]
    if root.tag != "robot":
        what = "is neither a URDF (<robot>) nor an MJCF (<mujoco>)"
        raise InputError(path, f"<{str(root.tag)[:40]}>", what)
    xacro = any(isinstance(e.tag, str) and "xacro" in e.tag.partition("}")[0] for e in root.iter())
    if xacro or any("${" in value for e in root.iter() for value in e.attrib.values()):
        what = "is a xacro file, which makes a URDF but is none"
        raise InputError(path, "", what, f"expand it first: xacro {path.name} > robot.urdf")
    return urdf_tree(path, root)


def _lacks(robot: Robot) -> Iterator[str]:
    """What the file does not say, and what to do."""
    source = str(robot.source)
    if open_ended := ", ".join(np.array(robot.joints)[np.isinf(robot.limits).any(axis=1)]):
        planned = "poses are planned within +-180 deg (+-1 m)"
        remedy = "give them in [robot.limits_deg] (or limits_mm)"
        yield f"no limits of {open_ended} in the {source}: {planned}; {remedy}"
    yield from odd_limits(robot)
    if not robot.masses.any():
        yield (
            f"no link masses in the {source}: the arm's own weight bends nothing in the model; a load, "
            "wrench or payload still does, and gravity_sag finds sag without masses"
        )
    if unread := robot.shapes.unread:
        yield (
            f"no shape of {', '.join(unread)}: no collision is checked there; put the meshes where "
            "the robot's file says, or give [robot.capsules_mm]"
        )


# -- where an arm begins and ends ------------------------------------------------------------------


def _ends_of(tree: Tree) -> tuple[str, str, tuple[str, ...]]:
    """Base and tip, and what a reader should know of the choice.

    Follow the longest row of joints, past a head or wheels, up to a hand: where several rows part that
    have no more joints than the way to them, these are fingers. A row ends before the first joint that
    is named as one that opens a gripper.

    Raises InputError where no joint moves, and where links hang in a circle.
    """
    hung = {joint.child for joint in tree.joints}
    order = [link for link in tree.links if link not in hung]
    roots, rows = [*order], dict[str, int]()
    for link in order:  # grows
        order += [joint.child for joint in tree.below[link] if joint.child in tree.below]
    for link in reversed(order):
        onward = (rows.get(j.child, 0) + j.moves for j in tree.below[link])
        rows[link] = max(onward, default=0)
    if not any(rows.values()):
        what = "has no moving joint on a link that hangs on none"
        raise InputError(tree.path, "", what, "is it the file of an arm?")
    links, way, start, notes = (
        [max(roots, key=lambda root: rows[root])],
        list[Joint](),
        0,
        list[str](),
    )
    while rows[links[-1]]:
        beyond = {j: rows.get(j.child, 0) + j.moves for j in tree.below[links[-1]]}
        chosen, *rest = sorted((j for j in beyond if beyond[j]), key=lambda j: -beyond[j])
        taken = sum(joint.moves for joint in way)
        if rest and beyond[chosen] <= taken:
            break
        if rivals := [tree.shown(j.child) for j in rest if beyond[j] == beyond[chosen]]:
            notes.append(
                f"arms of one length part at {links[-1]!r}: took that of "
                f"{tree.shown(chosen.child)!r}, not of {', '.join(map(repr, rivals))}; --tip takes "
                "another; one --tip for each takes all"
            )
        start = len(links) - 1 if rest and not taken else start
        links.append(chosen.child)
        way.append(chosen)
    row = [joint for joint in way if joint.moves]
    opens = [bool(_OPENS.search(n) and not _TURNS.search(n)) for n in (j.name.lower() for j in row)]
    arm = row[: opens.index(True)] if any(opens) and not opens[0] else row
    if left := row[len(arm) :]:
        names = ", ".join(joint.name for joint in left)
        within = f"To include it: --tip {tree.shown(left[-1].child)}"
        notes.append(f"{names} moves a gripper and is left out. {within}")
    before = links[start : links.index(arm[0].parent) + 1]
    return _base(tree, before), _tip(tree, arm[-1].child), tuple(notes)


def _base(tree: Tree, before: list[str]) -> str:
    names = [name for name in before if name in tree.named]
    called = [name for name in names if re.search(r"(^|_)base_link$", name)]
    solid = [name for name in names if not _GROUND.search(name.lower())]
    return (called or solid or names[-1:] or tree.named)[0]


def _tip(tree: Tree, last: str) -> str:
    """What is named like a tool, else the end of the one rigid line."""
    rigid = [last]
    for link in rigid:  # grows
        rigid += [j.child for j in tree.below[link] if not j.moves and j.child in tree.named]
    for word in _TIPS:
        for link in rigid:
            if re.search(rf"(^|[_-]){word}($|[_-])", link.lower()):
                return link
    while len(tree.below[last]) == 1 and tree.below[last][0].child in rigid:
        last = tree.below[last][0].child
    if last not in tree.named:
        raise InputError(tree.path, "", "its last body has no name", "name it, or give --tip")
    return last
