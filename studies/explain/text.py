"""Texts that ``posecal explain`` prints, and the keys of a cell from its schema."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from importlib.resources import files
from itertools import groupby
from operator import itemgetter
from textwrap import indent
from typing import Any

from studies.document import Column, Document, Lines, Part, Section, Sentence, Table

Rows = tuple[tuple[str, ...], Sequence[tuple[str, ...]]]
"""Titles, and rows of cells."""

_RULE = re.compile(r"\|[\s:|-]+\|")
_CELL = re.compile(r"(?<!\\)\|")
_NAMES = re.compile(r"`[^`]*`(?:(?:,| or|;)? \(?`[^`]*`\)?)*")
_MADE = re.compile(r"\{([\w.]+)\}")
_FENCE = re.compile(r"^```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def title_of(text: str) -> str:
    r"""What a topic is about.

    >>> title_of("# What it is\n\nWords.")
    'What it is'
    """
    return text.partition("\n")[0].removeprefix("# ")


def document_of(text: str, made: Callable[[str], Rows]) -> Document:
    """The document of a topic.

    made : gives the table that ``{name}`` stands for
    """
    body = _FENCE.sub(lambda found: indent(found[1], "    ", bool), text.partition("\n")[2])
    first, *others = re.split(r"^## ", body, flags=re.MULTILINE)
    sections = [Section("", "", tuple(_parts(first, made)))]
    for other in others:
        title, _, rest = other.partition("\n")
        sections.append(Section("", title, tuple(_parts(rest, made))))
    return Document((Sentence(title_of(text)),), tuple(sections))


def table_of(rows: Rows) -> Table[tuple[str, ...]]:
    """Rows of cells as a table."""
    heads, cells = rows
    columns = [Column(head, itemgetter(i)) for i, head in enumerate(heads)]
    return Table(columns, cells)


def _parts(text: str, made: Callable[[str], Rows]) -> Iterator[Part]:
    """Parts with an empty line between them; tables keep their own."""
    before = ""
    for kind, block in _blocks(text):
        if kind == "lines":
            yield Lines(block)
        elif kind == "table":
            heads, *rows = (_row(line) for line in block.splitlines() if not _RULE.fullmatch(line))
            yield table_of((heads, rows))
        elif found := _MADE.fullmatch(block):
            yield table_of(made(found[1]))
        else:
            apart = [] if before == "table" or _MADE.fullmatch(before) else [""]
            yield from (Sentence(own) for own in (*apart, *_sentences(block)))
        before = "table" if kind == "table" else block


def _blocks(text: str) -> Iterator[tuple[str, str]]:
    """Kind and text of what empty lines part; indented blocks that follow each other are one."""
    blocks = [block.strip("\n") for block in re.split(r"\n[ \t]*\n", text) if block.strip()]
    for kind, group in groupby(blocks, _kind):
        if kind == "lines":
            yield kind, "\n\n".join(group)
        else:
            yield from ((kind, block) for block in group)


def _kind(block: str) -> str:
    return "lines" if block.startswith("    ") else "table" if block.startswith("|") else "words"


def _sentences(block: str) -> list[str]:
    """A paragraph, or the entries of a list."""
    entries = re.split(r"^(?=- |\d+\. )", block, flags=re.MULTILINE)
    return [" ".join(entry.replace("**", "").split()) for entry in entries if entry.strip()]


def _row(line: str) -> tuple[str, ...]:
    """Cells; the marks of code are not needed where a cell holds names alone.

    >>> _row("| `a` | b | `c`, `d` | run `e` |")
    ('a', 'b', 'c, d', 'run `e`')
    """
    cells = [own.strip() for own in _CELL.split(line.strip().strip("|"))]
    return tuple(own.replace("`", "") if _NAMES.fullmatch(own) else own for own in cells)


_ABOVE = ("schema", "name")
_TOLD = ("instruments.NAME.sigma_mm.", "instruments.NAME.common.")  # as under [instrument]
_COMMON = re.compile(r"^instrument\.common\.\w+\.")  # each key may have these
_WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


TABLES = (
    "robot", "markers_mm", "instrument", "instruments", "bodies", "boards", "known_distances",
    "gravity", "payload", "load", "design", "timing", "diagnosis", "model", "acceptance",
)  # fmt: skip


def meanings() -> dict[str, str]:
    """What each key means. ``NAME`` is the user's; ``[]`` an entry of a list of tables."""
    text = (files("studies.explain") / "cell_keys.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def rows(table: str) -> list[tuple[str, str, str]]:
    """Key, form and meaning of every key of a table; of those above all tables for an empty name."""
    told = meanings()
    return [
        (key.removeprefix(table).lstrip("[].") or table, " or ".join(found), told[key])
        for key, found in forms().items()
        if table == ("" if key in _ABOVE else re.split(r"\W", key)[0])
    ]


def forms() -> dict[str, dict[str, None]]:
    """What may stand at every key of the cell, from its schema."""
    from calib.files.schema import CellFile

    schema = CellFile.model_json_schema()
    found: dict[str, dict[str, None]] = {}
    for key, form in _keys(schema, schema["$defs"], ""):
        found.setdefault(_COMMON.sub("instrument.common.KEY.", key), {})[form] = None
    return {key: own for key, own in found.items() if not key.startswith(_TOLD)}


def _keys(schema: Any, known: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    """Keys and forms below a path, every choice in turn."""
    if "$ref" in schema:
        schema = known[schema["$ref"].rpartition("/")[2]]
    for choice in schema.get("anyOf", schema.get("oneOf", ())):
        yield from _keys(choice, known, path)
    dot = f"{path}." if path else ""
    if "properties" in schema:
        for key, own in schema["properties"].items():
            yield from _keys(own, known, f"{dot}{key}")
    elif isinstance(own := schema.get("additionalProperties"), dict):
        inner = [*_keys(own, known, f"{dot}NAME")]
        forms = dict.fromkeys(form for key, form in inner if key == f"{dot}NAME")
        yield path, f"by name: {' or '.join(forms) or 'table'}"
        yield from (pair for pair in inner if pair[0] != f"{dot}NAME")
    elif schema.get("type") == "array" and "$ref" in str(schema.get("items")):
        yield path, "list of tables"
        yield from _keys(schema["items"], known, f"{path}[]")
    elif form := _form(schema):
        yield path, form


def _form(schema: Any) -> str:
    """What stands at a key that holds no table; nothing where it may be left out."""
    choices = [schema["const"]] if "const" in schema else schema.get("enum", [])
    if choices:
        return ", ".join(map(json.dumps, choices))
    if schema.get("type") == "array":
        many = len(schema.get("prefixItems", ()))
        return f"list of {many}" if many else "list"
    return _WORDS.get(schema.get("type", ""), "")
