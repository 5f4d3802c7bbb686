"""Parts of a document from cells that are text or numbers already.

For the sections of results that do not yet tell themselves (:meth:`studies.record.Record.told`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies import document
from studies.document import Detail, Mood, Part, Raw, Section, Sentence, listed
from studies.document.plain import Cell, plain_columns, shown
from studies.plots.style import Picture

__all__ = [
    "Cell", "Detail", "Figure", "Part", "Raw", "Section", "Table", "Text", "folded", "joint_columns",
    "listed", "shown",
]  # fmt: skip

_FOLDED = 16  # rows from which on a table is folded


def Text(text: str, mood: Mood = "") -> Sentence:
    """A paragraph, or a box of a mood."""
    return Sentence(text, mood)


def Table(
    header: Sequence[str],
    rows: Sequence[Sequence[Cell]],
    caption: str = "",
    of_poses: bool = False,
    fold: str | None = None,
) -> Part:
    """A table; fold is what its fold is called, None for one that stands open."""
    columns = plain_columns(header, rows)
    table = document.Table(
        columns, rows, fold or "", caption=caption, of_poses=of_poses, fold=False
    )
    return table if fold is None else Detail((table,), fold)


def Figure(picture: Picture, numbers: bool = True) -> Part:
    """A picture that is drawn already."""
    return document.Figure(lambda: picture, numbers)


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
