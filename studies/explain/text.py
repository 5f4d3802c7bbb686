"""A topic's text as a document: titles, paragraphs, lists, tables and lines as they stand.

The text is a little Markdown: ``# title`` first, ``## section``, tables between bars, lists of ``- ``
or ``1. ``, indented lines and fences for what stands as it is. ``{name}`` alone on a line stands for a
table that the package makes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from operator import itemgetter

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
    body = _FENCE.sub(lambda found: _indented(found[1]), text.partition("\n")[2])
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


def _indented(lines: str) -> str:
    return "".join(f"    {line}\n" for line in lines.splitlines())


def _parts(text: str, made: Callable[[str], Rows]) -> Iterator[Part]:
    """Parts with an empty line between them; tables keep their own."""
    before = ""
    for kind, block in _blocks(text):
        if kind == "lines":
            yield Lines(block)
        elif kind == "table":
            yield table_of(_rows(block))
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


def _rows(block: str) -> Rows:
    heads, *rows = (_row(line) for line in block.splitlines() if not _RULE.fullmatch(line))
    return heads, rows


def _row(line: str) -> tuple[str, ...]:
    """Cells; the marks of code are not needed where a cell holds names alone.

    >>> _row("| `a` | b | `c`, `d` | run `e` |")
    ('a', 'b', 'c, d', 'run `e`')
    """
    cells = [own.strip() for own in _CELL.split(line.strip().strip("|"))]
    return tuple(own.replace("`", "") if _NAMES.fullmatch(own) else own for own in cells)
