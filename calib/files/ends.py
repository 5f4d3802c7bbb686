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

    Where several rows part, those with no more joints than the way to them are fingers.
    """
    before, last, notes, node, taken = [root], None, [], root, 0
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
        if len(moving) > 1 and last is None:
            before = [node]
        node, taken = chosen, taken + len(chosen.joints)
        if node.joints:
            last = node
        elif last is None:
            before.append(node)
    if last is None:
        raise InputError(path, "", "has no moving joint", "is it the file of an arm?")
    every = tuple(joint for own in _all(root) for joint in own.joints)
    return Ends(_base(before), _tip(path, last), every, tuple(notes))


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
    rigid = [last]
    for node in rigid:  # grows, the nearest first
        rigid += [child for child in node.children if not child.joints]
    for word in _TIPS:
        for node in rigid:
            if re.search(rf"(^|[_-]){word}($|[_-])", node.name.lower()):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name
