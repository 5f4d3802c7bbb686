"""Columns of cells that are numbers or text already, as the tables below figures hold them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from operator import itemgetter
from typing import Any, TypeAlias

from studies.document.parts import Column, Table
from studies.document.rules import Rule

Cell: TypeAlias = str | float | int | None
_NUMBER = re.compile(  # linear in the length of a text, which may be a hostile name
    r"^(?:[\s.,eE+\N{MINUS SIGN}\N{PLUS-MINUS SIGN}%x-]*\d)+[\s.,eE+\-%]*$"
)


def plain_columns(
    header: Sequence[str], rows: Sequence[Sequence[Cell]]
) -> tuple[Column[Sequence[Any]], ...]:
    """A column for each title; those stand right that hold nothing but numbers."""
    return tuple(
        Column(title, itemgetter(i), Rule(_signed, "", all(_numeric(row[i]) for row in rows)))
        for i, title in enumerate(header)
    )


def table_of(
    header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = ""
) -> Table[Sequence[Any]]:
    """A table that stands open, of what no record tells."""
    return Table(plain_columns(header, rows), rows, caption=caption, fold=False)


def _numeric(cell: Cell) -> bool:
    return not isinstance(cell, str) or not cell or bool(_NUMBER.match(cell))


def _signed(value: Cell) -> str:
    """Numbers with a true minus sign, among names too."""
    text = shown(value)
    return text.replace("-", "\N{MINUS SIGN}") if _NUMBER.match(text) else text


def shown(value: Cell) -> str:
    """A cell as text: four digits, nothing for what is undefined.

    >>> shown(0.0123456), shown(None), shown(12), shown("m1")
    ('0.01235', '', '12', 'm1')
    """
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    return f"{value:.4g}" if math.isfinite(value) else ""
