"""Where an arm begins and ends among the links or bodies of its file, for ``posecal init``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import InputError
from calib.files.urdf import Urdf

_TIPS = ("tool0", "tcp", "tool", "ee", "eef", "end_effector", "attachment", "flange")
_GROUND = re.compile("world|map|odom|ground|footprint")
_GRIPS = ("gripper", "grip", "finger", "jaw", "claw", "knuckle", "thumb", "hand")
_TURNS = ("wrist", "roll", "yaw", "pitch", "rotat", "twist")  # a gripper that turns is on the arm


@dataclass(eq=False)
class Node:
    """A link, body or site, and the joints that move it against what it hangs on."""

    name: str
    joints: tuple[str, ...] = ()
    children: list[Node] = field(default_factory=list)
    longest: int = 0  # most joints in a row, of this and what hangs on it

    def all(self, rigid: bool = False) -> list[Node]:
        """The node and all that hangs on it, parents first; rigid : without a joint."""
        found = [self]
        for node in found:  # grows
            found += [own for own in node.children if not (rigid and own.joints)]
        return found

    def measured(self) -> Node:
        """Itself, once all that hangs on it knows its longest row."""
        for node in reversed(self.all()):
            node.longest = len(node.joints) + max((c.longest for c in node.children), default=0)
        return self


def urdf_tree(urdf: Urdf) -> Node:
    """The first link of the longest row. Raises InputError where links hang in a circle."""
    nodes = {e.get("name", ""): Node(e.get("name", "")) for e in urdf.root.findall("link")}
    hung = set()
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


def mjcf_tree(model: Any) -> Node:
    """The world, with bodies and sites."""
    joints = [np.flatnonzero(model.jnt_bodyid == b) for b in range(model.nbody)]
    nodes = [
        Node(model.body(b).name, tuple(model.joint(j).name for j in own))
        for b, own in enumerate(joints)
    ]
    for b, node in enumerate(nodes[1:], 1):
        nodes[int(model.body_parentid[b])].children.append(node)
    for s in range(model.nsite):
        nodes[int(model.site_bodyid[s])].children.append(Node(model.site(s).name))
    return nodes[0].measured()


def ends_of(path: Path, root: Node) -> tuple[str, str, tuple[str, ...]]:
    """Base and tip, and what a reader should know of the choice.

    Follow the longest row of joints, past a head or wheels, up to a hand. Where several rows part,
    those with no more joints than the way to them are fingers. Of one row the joints from the first
    one that opens a gripper on are left out.

    Raises InputError where no joint moves.
    """
    way, start, taken, notes = [root], 0, 0, list[str]()
    while moving := [child for child in way[-1].children if child.longest]:
        chosen, *others = sorted(moving, key=lambda child: -child.longest)
        if others and chosen.longest <= taken:
            break
        rivals = [_first_moving(own) for own in others if own.longest == chosen.longest]
        if rivals:
            notes.append(
                f"arms of one length part at {way[-1].name!r}: took that of {_first_moving(chosen)}, "
                f"not of {', '.join(rivals)}; --tip takes another; one --tip for each arm takes all"
            )
        if others and not taken:
            start = len(way) - 1
        way.append(chosen)
        taken += len(chosen.joints)
    row = [node for node in way if node.joints]
    if not row:
        raise InputError(path, "", "has no moving joint", "is it the file of an arm?")
    arm = _without_gripper(row)
    if gripping := row[len(arm) :]:
        names = ", ".join(joint for own in gripping for joint in own.joints)
        within = f". To include it: --tip {gripping[-1].name}" if gripping[-1].name else ""
        notes.append(f"{names} moves a gripper and is left out{within}")
    return _base(way[start : way.index(row[0])]), _tip(path, arm[-1]), tuple(notes)


def _first_moving(node: Node) -> str:
    return next(own.joints[0] for own in node.all() if own.joints) or "?"


def _without_gripper(row: list[Node]) -> list[Node]:
    """The nodes that joints of the arm move, without those that open and close a gripper.

    A gripper's joint is named so, or it is the last one and the end effector hangs beside it. The name
    of a link tells nothing: what a wrist turns may well be called a gripper.
    """
    gripping = [any(map(_named_of_gripper, node.joints)) for node in row]
    if any(gripping) and not gripping[0]:
        return row[: gripping.index(True)]
    beside = [own for own in row[-2].all(rigid=True) if row[-1] not in own.all()] if row[1:] else []
    return row[:-1] if any(_is_tip(own.name, _TIPS) for own in beside) else row


def _named_of_gripper(name: str) -> bool:
    """Whether a word of the name, in snake or camel case, is of a gripper that opens.

    >>> [_named_of_gripper(n) for n in ("jointGripper", "moving_jaw_1", "GripperYaw", "handle")]
    [True, True, False, False]
    """
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)]
    turns = any(word.startswith(_TURNS) for word in words)
    return not turns and any(word.rstrip("s") in _GRIPS for word in words)


def _is_tip(name: str, words: tuple[str, ...]) -> bool:
    return re.search(rf"(^|[_-])({'|'.join(words)})($|[_-])", name.lower()) is not None


def _base(before: list[Node]) -> str:
    names = [node.name for node in before if node.name]
    called = [name for name in names if re.search(r"(^|_)base_link$", name)]
    solid = [name for name in names if not _GROUND.search(name.lower())]
    return (called or solid or names[-1:])[0]


def _tip(path: Path, last: Node) -> str:
    """What is named like a tool, else the end of the one rigid line."""
    rigid = last.all(rigid=True)
    for word in _TIPS:
        for node in rigid:
            if _is_tip(node.name, (word,)):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name
