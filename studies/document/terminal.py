"""The short form: sentences and plain tables, without figures and details."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

from rich.console import RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from studies.document import LINE, Column, Document, Lines, Part, Section, Sentence, Table

_LABEL = 10  # letters
_AFTER_COMMA = re.compile(r"(?<=,)(?=[^\W\d])")  # not within a number


def terminal(document: Document, of: str = "") -> Iterator[RenderableType]:
    """The answer, then section by section, the titles of all but the first above them.

    of : name of what the result is of, before the answer
    """
    for number, sentence in enumerate(document.headline):
        text = f"{of}: {sentence.text}" if of and not number else sentence.text
        yield Text("\n".join(_wrapped(text)), style="bold")
    for number, section in enumerate(document.sections):
        yield from _section(section, titled=number > 0, below=number > 0 or bool(document.headline))


def _section(section: Section, titled: bool, below: bool) -> Iterator[RenderableType]:
    """Its parts; below : whether anything stands above them."""
    shown = list(_parts(section.parts, below))
    if shown and titled:
        yield Text(f"\n{section.title}", style="bold")
    yield from shown


def _parts(parts: Iterable[Part], below: bool) -> Iterator[RenderableType]:
    """Sentences in blocks, tables with an empty line about them."""
    below_table = False
    for kind, group in groupby(parts, type):
        if kind is Sentence:
            if below_table:
                yield Text("")
            yield Text("\n".join(_lines(group)))  # type: ignore[arg-type]
            below_table, below = False, True
        elif kind is Lines:
            yield from (Text(f"\n{part.text}") for part in group if isinstance(part, Lines))
            below_table, below = False, True
        elif kind is Table:
            for table in group:
                if isinstance(table, Table) and table.rows:
                    if below:
                        yield Text("")
                    yield from _table(table)
                    below_table = below = True


def _lines(sentences: Iterable[Sentence]) -> Iterator[str]:
    """Sentences, those with a label and what belongs to it beside it."""
    within = False
    for sentence in sentences:
        within = within or bool(sentence.label)
        if not within:
            yield from _wrapped(sentence.text)
            continue
        first, *rest = _wrapped(sentence.text, LINE - _LABEL - 1)
        yield f"{sentence.label:<{_LABEL}} {first}"
        yield from (f"{'':<{_LABEL}} {line}" for line in rest)


class _Wrapper(textwrap.TextWrapper):
    """Breaks at blanks, and lists without any, ``effect:A1,A2,A3``, after a comma."""

    def _split(self, text: str) -> list[str]:
        return [part for chunk in super()._split(text) for part in _AFTER_COMMA.split(chunk)]


def _wrapped(text: str, width: int = LINE) -> list[str]:
    """Lines; names stay whole."""
    wrapper = _Wrapper(width, break_long_words=False, break_on_hyphens=False)
    return wrapper.wrap(text) or [""]


def _table(table: Table[Any]) -> Iterator[RenderableType]:
    columns = [column for column in table.columns if not column.detail]
    rows = table.rows[: table.most]
    made = RichTable(box=None, pad_edge=False, header_style="bold")  # without lines
    for title, column in zip(_heads(columns), columns, strict=True):
        justify: Any = "right" if column.rule.number else "left"
        made.add_column(Text(title), justify=justify, overflow="fold")
    made.show_header = any(column.title for column in columns)
    for row in rows:
        made.add_row(*(Text(column.cell(row)) for column in columns))
    yield made
    if len(rows) < len(table.rows):
        yield Text(f"and {len(table.rows) - len(rows)} more (JSON)")


def _heads(columns: Sequence[Column[Any]]) -> list[str]:
    """Titles with the unit below, all ending in the same line."""
    heads = [f"{c.title}\n[{c.unit}]" if c.unit else c.title for c in columns]
    high = max(head.count("\n") for head in heads)
    return ["\n" * (high - head.count("\n")) + head for head in heads]
