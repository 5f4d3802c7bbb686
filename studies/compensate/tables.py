"""A compensation as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.tables import plain_table

_MOST = 8  # targets that are worth a line each
_ROWS = (
    ("nominal commands miss by", "before"),
    ("corrected commands, expected", "expected"),
    ("  of it: cannot be corrected", "left"),
    ("  of it: the parameters' uncertainty", "from_parameters"),
    ("  of it: the arm errs anew at each pose", "scatter"),
    ("  of it: not explained by the model", "unexplained"),
)


def compensation_tables(name: str, fields: dict[str, Any]) -> Iterator[RenderableType]:
    """The error before and after, what it consists of, and the targets that stand out."""
    count = len(fields["targets"])
    at = "markers" if fields["errors_at"] == "markers" else "tip's origin"
    before, after = (fields["rms_mm"][key] for key in ("before", "expected"))
    yield Text(
        f"{name}: {count} target{'s' if count > 1 else ''} corrected, "
        f"{before:.4f} -> {after:.4f} mm RMS at the {at}",
        style="bold",
    )
    yield _errors(fields)
    limited = [t for t in fields["targets"] if t["limited_by"]]
    if limited:
        yield Text(f"\n{len(limited)} of {count} targets are not met in full:")
        yield _limited(limited)
    if len(limited) > _MOST:
        yield Text(f"and {len(limited) - _MOST} with less left (JSON)")


def _errors(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\ndistance from the wanted place", "left"),
        ("RMS\n[mm]", "right"),
        ("p95\n[mm]", "right"),
        ("max\n[mm]", "right"),
    )
    for label, key in _ROWS:
        if key == "scatter" and not fields["rms_mm"][key]:
            continue
        figures = [fields[figure].get(key) for figure in ("rms_mm", "p95_mm", "max_mm")]
        table.add_row(label, *("" if value is None else f"{value:.4f}" for value in figures))
    return table


def _limited(limited: list[dict[str, Any]]) -> Table:
    table = plain_table(
        ("target", "left"), ("left [mm]", "right"), ("turned [mrad]", "right"), ("because", "left")
    )
    for target in sorted(limited, key=lambda t: -float(t["left_mm"]))[:_MOST]:
        table.add_row(
            target["pose"],
            f"{target['left_mm']:.4f}",
            f"{target['turn_left_mrad']:.3f}",
            target["limited_by"],
        )
    return table
