"""Rows of figures as a table in the terminal, and rows of fields as a table in a file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from typing import Any

from rich.table import Table
from rich.text import Text


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """Rows under their headings; the first column and columns of words stand left, figures right."""
    rows = list(rows)
    keys = list(dict.fromkeys(key for row in rows for key in row))
    texts = {key: [shown(row.get(key)) for row in rows] for key in keys}
    lines = max((key.count("\n") for key in keys), default=0)
    made = Table(box=None, pad_edge=False, header_style="bold")
    for k, (key, own) in enumerate(texts.items()):
        figures = k > 0 and all(map(_figure, own))
        above = "\n" * (lines - key.count("\n"))
        side: Any = "right" if figures else "left"
        made.add_column(Text(above + key), justify=side, overflow="fold")
    for row in zip(*texts.values(), strict=True):
        made.add_row(*row)
    return made


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows of a file, the columns' names first."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def shown(value: object) -> str:
    """A cell of a table: four digits of a number, a dash where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _figure(text: str) -> bool:
    return not text or text[0].isdigit() or text[0] in "-+<>"
