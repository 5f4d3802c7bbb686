"""What a section is made of: text, tables and figures, before they become a page."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from markupsafe import Markup

from studies.plots.style import Picture

Cell: TypeAlias = str | float | int | None
_NUMBER = re.compile(  # linear in the length of a text, which may be a hostile name
    r"^(?:[\s.,eE+\N{MINUS SIGN}\N{PLUS-MINUS SIGN}%x-]*\d)+[\s.,eE+\-%]*$"
)
_FOLDED = 16  # rows from which on a table is folded


@dataclass(frozen=True)
class Text:
    """A paragraph; kind "" for plain text; "good", "warn", "note" or "next" for a box."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table; in one of poses the first column names them.

    fold : what the fold is called, None for a table that stands open
    """

    header: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    of_poses: bool = False
    fold: str | None = None

    @property
    def shown(self) -> list[list[str]]:
        """The cells as text, numbers with a true minus sign."""
        return [[_signed(shown(cell)) for cell in row] for row in self.rows]

    @property
    def numeric(self) -> list[bool]:
        """Whether a column holds numbers only."""
        columns = zip(*self.shown, strict=True) if self.rows else [()] * len(self.header)
        return [all(not cell or _NUMBER.match(cell) for cell in column) for column in columns]


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture with its caption, and its numbers folded below."""

    picture: Picture
    numbers: bool = True


@dataclass(frozen=True)
class Raw:
    """Markup made by the report itself."""

    html: Markup


Part: TypeAlias = Text | Table | Figure | Raw


@dataclass(frozen=True)
class Section:
    """A section of the page.

    key : str, its anchor; lit : pose -> the name under which the page lights it
    """

    key: str
    title: str
    parts: tuple[Part, ...]
    lit: Mapping[str, str] = field(default_factory=dict)


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


def _signed(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}") if _NUMBER.match(text) else text


def joint_columns(poses: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Title with unit, and where the value stands in the fields of a pose, of each joint."""
    return [
        (f"{name} [{unit}]", key, name)
        for key, unit in (("joints_deg", "deg"), ("joints_mm", "mm"))
        for name in poses[0].get(key, {})
    ]


def folded(name: str, rows: Sequence[Sequence[Cell]]) -> str | None:
    """The name of a fold where a table is long."""
    return f"{name} ({len(rows)})" if len(rows) > _FOLDED else None


def listed(names: Sequence[str], most: int = 8) -> str:
    """Names with commas, the first few of many.

    >>> listed(["a", "b"]), listed(list("abcdefghij"), 3)
    ('a, b', 'a, b, c and 7 more')
    """
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"
