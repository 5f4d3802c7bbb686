"""What all tables for the terminal share."""

from __future__ import annotations

import math

from rich.table import Table
from rich.text import Text


def plain_table(*columns: tuple[str, str]) -> Table:
    """A table without lines; columns are (title, "left" or "right")."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title, justify in columns:
        table.add_column(Text(title), justify=justify, overflow="fold")  # type: ignore[arg-type]
    return table


def number(value: float | None) -> str:
    """Four digits, or a dash for what is undefined."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.4g}"
