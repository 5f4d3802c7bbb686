"""Where the arm of a robot's file begins and ends: a proposal for base and tip."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from calib.errors import InputError
from calib.files.mjcf_tree import WORLD, inside, joints_of
from calib.files.urdf import MOVING

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
    for joint in root.findall("joint"):
        ends = [joint.find(end) for end in ("parent", "child")]
        names = ["" if e is None else e.get("link", "") for e in ends]
        if all(name in nodes for name in names) and names[1] not in hung:
            hung.add(names[1])
            nodes[names[0]].children.append(nodes[names[1]])
            if joint.get("type") in MOVING:
                nodes[names[1]].joints = (joint.get("name", ""),)
    roots = [node for name, node in nodes.items() if name not in hung]
    for node in roots:
        _measure(node)
    if not roots:
        raise InputError(path, "", "has no first link", "links must hang on one that hangs on none")
    return _ends(path, max(roots, key=lambda node: node.longest))


def mjcf_ends(path: Path, root: Element) -> Ends:
    """Raises InputError where no joint moves."""
    world = Node(WORLD, ())
    for element in root.findall("worldbody"):
        pending = [(world, element)]
        for node, body in pending:  # grows as bodies are found
            for child in inside(body):
                if child.tag in ("body", "site"):
                    joints = joints_of(child) if child.tag == "body" else []
                    names = tuple(joint.get("name", "") for joint in joints)
                    node.children.append(Node(child.get("name", ""), names))
                    pending.append((node.children[-1], child))
    _measure(world)
    return _ends(path, world)


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
                f"not of {others}; --tip takes another"
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
        if any(_named_like_tool(own.name) for own in beside):
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


def _named_like_tool(name: str) -> bool:
    return any(re.search(rf"(^|[_-]){word}($|[_-])", name.lower()) for word in _TIPS)


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
            if re.search(rf"(^|[_-]){word}($|[_-])", node.name.lower()):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name
