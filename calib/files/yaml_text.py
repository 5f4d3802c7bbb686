"""YAML with the place of every value, so that a file can be written again with other numbers.

Values stay text: nothing is constructed from a tag, and only those of plain data are read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from calib.errors import InputError
from calib.files.read import read_text

_LARGEST_FILE = 5_000_000  # bytes, half a minute
_DEEPEST = 20  # maps in maps
_CORE = ("map", "seq", "str", "int", "float", "bool", "null", "timestamp", "merge", "value")
_TAGS = {f"!!{name}" for name in (*_CORE, "opencv-matrix")}
_REMEDY = "write it as the maker's own file is written"


@dataclass(frozen=True)
class Scalar:
    """A value without its quotation marks, its line, and where it begins and ends in the text."""

    word: str
    line: int
    start: int
    stop: int


Node: TypeAlias = "Scalar | dict[str, Node] | list[Node]"


@dataclass(frozen=True)
class YamlText:
    """A file's text and what it holds: a map at the top, or a list under the key ``""``."""

    text: str
    root: dict[str, Node]


def read_yaml(path: Path) -> YamlText:
    """The only document of a file; no value is an empty map. Raises InputError, naming the line."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    text = read_text(path, _LARGEST_FILE)
    try:
        found = [_node(path, own, 0) for own in YAML(typ="safe", pure=True).compose_all(text)]
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(path, f"line {line}", f"is no YAML: {error.problem}", _REMEDY) from None
    except (YAMLError, ValueError, AssertionError):  # the last two of odd directives
        raise InputError(path, "", "is no YAML", _REMEDY) from None
    except RecursionError:
        raise InputError(path, "", "is nested too deeply", _REMEDY) from None
    root, *more = [*found, {}][: max(len(found), 1)]
    if any(more):
        raise InputError(path, "", "holds a second document", "keep one in the file")
    if isinstance(root, Scalar):
        what = "holds neither 'key: value' nor '- value'"
        raise InputError(path, f"line {root.line}", what, _REMEDY)
    return YamlText(text, root if isinstance(root, dict) else {"": root})


def number_at(
    path: Path,
    node: Node,
    largest: float = math.inf,
    what: str = "is no number",
    remedy: str = "",
) -> float:
    """The number at a node. Raises InputError, naming the line, where it is none, or not below.

    what, remedy : that are said of its word
    """
    own = scalar_at(path, node)
    try:
        value = float(own.word)
    except ValueError:
        value = math.nan
    if not abs(value) < largest:
        raise InputError(path, f"line {own.line}", f"{own.word[:40]!r} {what}", remedy)
    return value


def scalar_at(path: Path, node: Node) -> Scalar:
    """The value at a node. Raises InputError for a map or list."""
    if not isinstance(node, Scalar):
        raise InputError(path, "", "holds a list where a name or number belongs")
    return node


def leaves(node: Node) -> list[Node]:
    """What lists, and lists in lists, hold; a node of another kind alone."""
    return [own for part in node for own in leaves(part)] if isinstance(node, list) else [node]


def rewritten(text: str, values: Mapping[Scalar, str]) -> str:
    """The text with other values in place of those given."""
    for old in sorted(values, key=lambda scalar: -scalar.start):
        text = text[: old.start] + values[old] + text[old.stop :]
    return text


def _node(path: Path, node: Any, depth: int) -> Node:
    """A node of the library, its maps as dictionaries."""
    if node is None:
        return {}
    line = node.start_mark.line + 1
    if node.anchor is not None:  # references to references grow without bound
        what = f"&{node.anchor} and references to it are not read"
        raise InputError(path, f"line {line}", what, "write the value out")
    tag = str(node.tag).replace("tag:yaml.org,2002:", "!!")
    if tag not in _TAGS:  # nothing would come of it, yet it is no file of a maker
        what = f"has the tag {tag[:60]!r}, which is not read"
        raise InputError(path, f"line {line}", what, _REMEDY)
    if depth > _DEEPEST:
        raise InputError(path, f"line {line}", "is nested too deeply", _REMEDY)
    if node.id == "scalar":
        if node.start_mark.index == node.end_mark.index:
            return {}
        return Scalar(node.value, line, node.start_mark.index, node.end_mark.index)
    if node.id == "sequence":
        return [_node(path, own, depth + 1) for own in node.value]
    found: dict[str, Node] = {}
    for key, value in node.value:
        if key.id != "scalar":
            raise InputError(path, f"line {line}", "has a key that is no word", _REMEDY)
        if key.value in found:
            where = f"line {key.start_mark.line + 1}"
            raise InputError(path, where, f"key {key.value!r} stands twice", "keep one")
        found[key.value] = _node(path, value, depth + 1)
    return found
