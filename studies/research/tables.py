"""Rows of figures as a table in the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rich.table import Table
from rich.text import Text


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """Rows under their headings; the first column and columns of words are left, figures right."""
    rows = list(rows)
    keys = list(dict.fromkeys(key for row in rows for key in row))
    lines = max((key.count("\n") for key in keys), default=0)
    texts = {key: [shown(row.get(key)) for row in rows] for key in keys}
    made = Table(box=None, pad_edge=False, header_style="bold")
    for k, (key, column) in enumerate(texts.items()):
        figures = k > 0 and all(not t or t[0].isdigit() or t[0] in "-+<>" for t in column)
        above, side = "\n" * (lines - key.count("\n")), "right" if figures else "left"
        made.add_column(Text(above + key), justify=side, overflow="fold")  # type: ignore[arg-type]
    for row in zip(*texts.values(), strict=True):
        made.add_row(*row)
    return made


def shown(value: object) -> str:
    """A cell of a table: four digits of a number, a dash where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
