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
    """A link, body or site, and how many joints move it against what it hangs on."""

    name: str
    moves: int
    children: list[Node] = field(default_factory=list)
    below: int = 0  # joints of this and all that hangs on it


@dataclass(frozen=True)
class Ends:
    """Names of base and tip, and what a reader should know of the choice."""

    base: str
    tip: str
    notes: tuple[str, ...]


def urdf_ends(path: Path, root: Element) -> Ends:
    """Raises InputError where no joint moves, or links hang in a circle."""
    nodes = {e.get("name", ""): Node(e.get("name", ""), 0) for e in root.findall("link")}
    hung = set()
    for joint in root.findall("joint"):
        ends = [joint.find(end) for end in ("parent", "child")]
        names = ["" if e is None else e.get("link", "") for e in ends]
        if all(name in nodes for name in names) and names[1] not in hung:
            hung.add(names[1])
            nodes[names[0]].children.append(nodes[names[1]])
            nodes[names[1]].moves = int(joint.get("type") in MOVING)
    roots = [node for name, node in nodes.items() if name not in hung]
    for node in roots:
        _count(node)
    if not roots:
        raise InputError(path, "", "has no first link", "links must hang on one that hangs on none")
    return _ends(path, max(roots, key=lambda node: node.below), beyond=False)


def mjcf_ends(path: Path, root: Element) -> Ends:
    """Raises InputError where no joint moves."""
    world = Node(WORLD, 0)
    for element in root.findall("worldbody"):
        pending = [(world, element)]
        for node, body in pending:  # grows as bodies are found
            for child in inside(body):
                if child.tag in ("body", "site"):
                    moves = len(joints_of(child)) if child.tag == "body" else 0
                    node.children.append(Node(child.get("name", ""), moves))
                    pending.append((node.children[-1], child))
    _count(world)
    return _ends(path, world, beyond=True)


def _all(root: Node) -> list[Node]:
    """The node and all that hangs on it, parents first."""
    found = [root]
    for node in found:  # grows
        found += node.children
    return found


def _count(root: Node) -> None:
    for node in reversed(_all(root)):
        node.below = node.moves + sum(child.below for child in node.children)


def _ends(path: Path, root: Node, beyond: bool) -> Ends:
    """Follow the one branch that moves; where several do, the arm ends, if it has begun."""
    before, last, notes, node = [root], None, [], root
    while moving := [child for child in node.children if child.below]:
        if len(moving) > 1 and last is not None:
            names = ", ".join(_first_moving(child) or "?" for child in moving)
            notes.append(f"the arm ends at {last.name!r}, behind which {names} move (a gripper?)")
            break
        chosen = max(moving, key=lambda child: child.below)
        if len(moving) > 1:
            others = ", ".join(_first_moving(c) or "?" for c in moving if c is not chosen)
            notes.append(
                f"several chains leave {node.name!r}: took the longest, not that of {others}"
            )
            before = [node]
        node = chosen
        if node.moves:
            last = node
        elif last is None:
            before.append(node)
    if last is None:
        raise InputError(path, "", "has no moving joint", "is it the file of an arm?")
    return Ends(_base(before), _tip(path, last, beyond), tuple(notes))


def _first_moving(node: Node) -> str:
    return next((n.name for n in _all(node) if n.moves), "")


def _base(before: list[Node]) -> str:
    names = [node.name for node in before if node.name]
    for name in names:
        if re.search(r"(^|_)base_link$", name):
            return name
    solid = [name for name in names if not re.search(f"({'|'.join(_GROUND)})", name.lower())]
    return (solid or names[-1:])[0]


def _tip(path: Path, last: Node, beyond: bool) -> str:
    """What is named like a tool, else the end of the one rigid line.

    beyond : whether a tip may stand behind what fingers hang on; a URDF's chain may not pass it
    """
    rigid = [last]
    for node in rigid:  # grows, the nearest first
        if beyond or not any(child.moves for child in node.children):
            rigid += [child for child in node.children if not child.moves]
    for word in _TIPS:
        for node in rigid:
            if re.search(rf"(^|[_-]){word}($|[_-])", node.name.lower()):
                return node.name
    while len(last.children) == 1 and last.children[0] in rigid and last.children[0].name:
        last = last.children[0]
    if not last.name:
        raise InputError(path, "", "its last body has no name", "name it, or give --tip")
    return last.name
