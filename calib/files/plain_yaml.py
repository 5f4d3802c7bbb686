"""Read the little YAML that kinematics files are made of: maps in maps, and numbers or words.

A full reader of YAML is more than such a file needs and can be made to run what it reads. Where each
value stands is kept, so that a file can be written again with other numbers and all else as it was.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from calib.errors import InputError
from calib.files.read import read_text

_LARGEST_FILE = 1_000_000  # bytes
_LINE = re.compile(r"(?P<indent> *)(?P<key>[\w.-]+|\"[^\"]*\"|'[^']*'):(?:[ ]+(?P<value>.*))?$")
_PAIR = re.compile(r"\s*([\w.-]+)\s*:\s*([^,{}\[\]\s]+)\s*(?:,|$)")


@dataclass(frozen=True)
class Scalar:
    """A value as written, its line, and where it begins and ends in the text."""

    text: str
    line: int
    start: int
    stop: int


Node: TypeAlias = "Scalar | dict[str, Node]"


@dataclass(frozen=True)
class YamlText:
    """A file's text and what it holds."""

    text: str
    root: dict[str, Node]


def read_yaml(path: Path) -> YamlText:
    """Maps by indentation, or in one line as ``{x: 0, y: 0}``. Raises InputError for any other YAML."""
    text = read_text(path, _LARGEST_FILE)
    root: dict[str, Node] = {}
    open_maps: list[tuple[int, dict[str, Node]]] = [(-1, root)]
    offset = 0
    for number, raw in enumerate(text.split("\n"), 1):
        start, offset = offset, offset + len(raw) + 1
        line = re.sub(r"(^|\s)#.*$", "", raw).rstrip()
        if not line or line == "---":
            continue
        found = _LINE.match(line)
        if found is None:
            what = "is none of the YAML that a kinematics file needs, 'key: value'"
            raise InputError(
                path, f"line {number}", what, "write it as the maker's own file is written"
            )
        indent = len(found["indent"])
        while open_maps[-1][0] >= indent:
            open_maps.pop()
        here, key = open_maps[-1][1], found["key"].strip("\"'")
        if key in here:
            raise InputError(path, f"line {number}", f"key {key!r} stands twice", "keep one")
        if found["value"] is None:
            inner: dict[str, Node] = {}
            here[key] = inner
            open_maps.append((indent, inner))
        else:
            here[key] = _value(path, number, found["value"], start + found.start("value"))
    return YamlText(text, root)


def rewritten(text: str, values: Mapping[Scalar, str]) -> str:
    """The text with other values in place of those given."""
    for old in sorted(values, key=lambda scalar: -scalar.start):
        text = text[: old.start] + values[old] + text[old.stop :]
    return text


def _value(path: Path, number: int, value: str, start: int) -> Node:
    if not value.startswith("{"):
        if value[:1] in "[&*!|>%@`":
            raise InputError(path, f"line {number}", f"{value[:40]!r} is no number or word")
        return Scalar(value, number, start, start + len(value))
    inner, at = value.removeprefix("{").removesuffix("}"), 0
    found: dict[str, Node] = {}
    while inner[at:].strip():
        pair = _PAIR.match(inner, at)
        if pair is None or not value.endswith("}"):
            what = f"{value[:40]!r} is no map of numbers"
            raise InputError(path, f"line {number}", what, "write it as {x: 0, y: 0, ..}")
        begin = start + 1 + pair.start(2)
        found[pair[1]] = Scalar(pair[2], number, begin, begin + len(pair[2]))
        at = pair.end()
    return found
