"""Parts of a document from cells that are text or numbers already: of sections that no record tells."""

from __future__ import annotations

from collections.abc import Sequence

from studies import document
from studies.document import Detail, Part, Section, Sentence
from studies.document.plain import Cell, plain_columns, shown

__all__ = ["Part", "Section", "Sentence", "Table", "shown"]


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
