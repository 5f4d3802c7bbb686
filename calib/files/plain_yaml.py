"""Read the YAML that robots and cameras are described in: maps, lists, numbers and words.

A full reader of YAML is more than such a file needs and can be made to run what it reads. Where each
value stands is kept, so that a file can be written again with other numbers and all else as it was.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from calib.errors import InputError
from calib.files.read import read_text

_LARGEST_FILE = 20_000_000  # bytes
_DEEPEST = 20  # maps in maps
_KEY = re.compile(r"(?P<key>[\w.-]+|\"[^\"]*\"|'[^']*'):(?:[ ]+(?P<value>.*))?$")
_DASH = re.compile(r"-(?:[ ]+|$)")
_COMMENT = re.compile(r"(?:^|\s)#")
_BLANK = re.compile(r"(?:\s|(?<=\s)#[^\n]*)*")
_FLOW_KEY = re.compile(r"([\w.-]+|\"[^\"]*\"|'[^']*')\s*:\s*")
_FLOW_WORD = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'|[^\s,\[\]{}&*!|>%@`\"'][^\n,\[\]{}#]*")
_OPENCV = re.compile(r"!!opencv-matrix\b\s*")


@dataclass(frozen=True)
class Scalar:
    """A value as written, its line, and where it begins and ends in the text."""

    text: str
    line: int
    start: int
    stop: int

    @property
    def word(self) -> str:
        """The value without its quotation marks."""
        quoted = len(self.text) > 1 and self.text[0] == self.text[-1] and self.text[0] in "\"'"
        return self.text[1:-1] if quoted else self.text


Node: TypeAlias = "Scalar | dict[str, Node] | list[Node]"


@dataclass(frozen=True)
class YamlText:
    """A file's text and what it holds: a map at the top, or a list under the key ``""``."""

    text: str
    root: dict[str, Node]


@dataclass(frozen=True)
class _Line:
    """What stands in a line behind so many blanks, and where it begins in the text."""

    number: int
    indent: int
    text: str
    start: int


def read_yaml(path: Path) -> YamlText:
    """Maps and lists by indentation, or in brackets. Raises InputError for any other YAML."""
    text = read_text(path, _LARGEST_FILE)
    reader = _Reader(path, text, _lines(path, text))
    root = reader.document() if reader.lines else {}
    return YamlText(text, root if isinstance(root, dict) else {"": root})


def rewritten(text: str, values: Mapping[Scalar, str]) -> str:
    """The text with other values in place of those given."""
    for old in sorted(values, key=lambda scalar: -scalar.start):
        text = text[: old.start] + values[old] + text[old.stop :]
    return text


def _lines(path: Path, text: str) -> list[_Line]:
    """Lines that hold something, of the first document. Raises InputError where there are more."""
    found: list[_Line] = []
    offset, ended = 0, False
    for number, raw in enumerate(text.split("\n"), 1):
        start, offset = offset, offset + len(raw) + 1
        line = _uncommented(raw).rstrip()
        if not line or line.startswith("%"):
            continue
        if line in ("---", "..."):
            ended = bool(found)
            continue
        if ended:
            what = "begins a second document"
            raise InputError(path, f"line {number}", what, "keep one in the file")
        inner = line.lstrip(" ")
        indent = len(line) - len(inner)
        found.append(_Line(number, indent, inner, start + indent))
    return found


def _uncommented(line: str) -> str:
    marks = (mark.start() for mark in _COMMENT.finditer(line))
    return line[: next((at for at in marks if not line[:at].count('"') % 2), len(line))]


class _Reader:
    """Walks through the lines of one file."""

    def __init__(self, path: Path, text: str, lines: list[_Line]) -> None:
        self.path, self.text, self.lines, self.at = path, text, lines, 0
        self.ends = [end.start() for end in re.finditer("\n", text)]

    def fault(self, line: _Line, what: str = "", remedy: str = "") -> InputError:
        return InputError(
            self.path,
            f"line {line.number}",
            what or "is none of the YAML that is read here, 'key: value' or '- value'",
            remedy if what else "write it as the maker's own file is written",
        )

    def document(self) -> Node:
        """The whole: a block, or brackets as in JSON."""
        first = self.lines[0]
        if first.text[0] not in "{[":
            return self.block(-1, 0)
        found = self._value(first, first.text, first.start, 0, 0, under_key=False)
        if self.at < len(self.lines):
            raise self.fault(self.lines[self.at])
        return found

    def block(self, above: int, depth: int) -> Node:
        """The map or list of lines that stand farther right than the one above."""
        first = self.lines[self.at]
        if depth > _DEEPEST:
            raise self.fault(first, "is nested too deeply")
        found: Node = [] if _DASH.match(first.text) else {}
        while self.at < len(self.lines) and self.lines[self.at].indent == first.indent:
            line = self.lines[self.at]
            if isinstance(found, list) != bool(_DASH.match(line.text)):
                break
            if isinstance(found, list):
                found.append(self._entry(line, depth))
            elif isinstance(found, dict):
                self._pair(line, found, depth)
        if self.at < len(self.lines) and self.lines[self.at].indent > above:
            raise self.fault(self.lines[self.at])
        return found

    def _pair(self, line: _Line, into: dict[str, Node], depth: int) -> None:
        found = _KEY.match(line.text)
        if found is None:
            raise self.fault(line)
        key = found["key"].strip("\"'")
        if key in into:
            raise self.fault(line, f"key {key!r} stands twice", "keep one")
        value = found["value"] or ""
        start = line.start + found.start("value") if value else 0
        into[key] = self._value(line, value, start, line.indent, depth, under_key=True)

    def _entry(self, line: _Line, depth: int) -> Node:
        """What follows a dash: a value, or a block whose first line follows it at once."""
        dash = _DASH.match(line.text)
        skip = dash.end() if dash else 0
        rest = line.text[skip:]
        if _KEY.match(rest) or _DASH.match(rest):
            self.lines[self.at] = _Line(line.number, line.indent + skip, rest, line.start + skip)
            return self.block(line.indent, depth + 1)
        return self._value(line, rest, line.start + skip, line.indent, depth, under_key=False)

    def _value(
        self, line: _Line, value: str, start: int, indent: int, depth: int, *, under_key: bool
    ) -> Node:
        """A value in its line, brackets that may go on over lines, or the block below."""
        if matrix := _OPENCV.match(value):
            value, start = value[matrix.end() :], start + matrix.end()
        if not value:
            self.at += 1
            if self.at < len(self.lines):
                below = self.lines[self.at]
                beside = under_key and below.indent == indent and _DASH.match(below.text)
                if below.indent > indent or beside:
                    return self.block(indent, depth + 1)
            return {}
        if value[0] not in "{[":
            if value[0] in "&*!|>%@`":
                raise self.fault(line, f"{value[:40]!r} is no number or word")
            self.at += 1
            return Scalar(value, line.number, start, start + len(value))
        node, end = self._flow(start, line, 0)
        while self.at < len(self.lines) and self.lines[self.at].start < end:
            last = self.lines[self.at]
            self.at += 1
            if last.start + len(last.text) > end:
                follows = last.text[end - last.start :].strip()[:40]
                raise self.fault(last, f"{follows!r} follows a bracket", "begin a new line")
        return node

    def _flow(self, at: int, line: _Line, depth: int) -> tuple[Node, int]:
        """A map or list in brackets, which begins at a place of the text, and where it ends."""
        mapped, close = self.text[at] == "{", "}" if self.text[at] == "{" else "]"
        found_map: dict[str, Node] = {}
        found_list: list[Node] = []
        begin, at = at, self._past_blank(at + 1)
        while self.text[at : at + 1] != close:
            key = _FLOW_KEY.match(self.text, at) if mapped else None
            if (mapped and key is None) or depth > _DEEPEST:
                raise self._no_flow(line, begin, mapped)
            node, at = self._flow_value(key.end() if key else at, line, begin, depth, mapped)
            if key is None:
                found_list.append(node)
            elif (name := key[1].strip("\"'")) in found_map:
                raise self.fault(line, f"key {name!r} stands twice", "keep one")
            else:
                found_map[name] = node
            at = self._past_blank(at)
            if self.text[at : at + 1] == ",":
                at = self._past_blank(at + 1)
            elif self.text[at : at + 1] != close:
                raise self._no_flow(line, begin, mapped)
        return (found_map if mapped else found_list), at + 1

    def _flow_value(
        self, at: int, line: _Line, begin: int, depth: int, mapped: bool
    ) -> tuple[Node, int]:
        at = self._past_blank(at)
        if self.text[at : at + 1] in ("{", "["):
            return self._flow(at, line, depth + 1)
        word = _FLOW_WORD.match(self.text, at)
        if word is None:
            raise self._no_flow(line, begin, mapped)
        text = word[0].rstrip()
        number = bisect_left(self.ends, at) + 1
        return Scalar(text, number, at, at + len(text)), at + len(text)

    def _past_blank(self, at: int) -> int:
        blank = _BLANK.match(self.text, at)
        return blank.end() if blank else at

    def _no_flow(self, line: _Line, begin: int, mapped: bool) -> InputError:
        what = "map of numbers" if mapped else "list of numbers"
        shown = self.text[begin:].split("\n", 1)[0][:40]
        remedy = "write it as {x: 0, y: 0, ..}" if mapped else "write it as [0, 0, ..]"
        return self.fault(line, f"{shown!r} is no {what}", remedy)
