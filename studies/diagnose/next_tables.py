"""What to measure next, as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.tables import plain_table

_MOST_PAIRS = 6


def next_tables(fields: dict[str, Any]) -> Iterator[RenderableType]:
    """Rivals with their prospects, the poses that split them, and what to do where none can."""
    predicted = fields.get("next_poses_predicted", [])
    if not predicted:
        return
    yield Text("")
    yield _prospects(predicted[:_MOST_PAIRS])
    if len(predicted) > _MOST_PAIRS:
        yield Text(f"and {len(predicted) - _MOST_PAIRS} more pairs: JSON, next_poses_predicted")
    for entry in predicted[:_MOST_PAIRS]:
        yield from _remedies(entry)
    if fields["next_poses"]:
        yield Text("")
        yield _poses(fields["next_poses"])
        yield Text(f"read {'; '.join(fields['next_poses_assume'])}")


def _prospects(predicted: list[dict[str, Any]]) -> Table:
    table = plain_table(
        ("\nin doubt", "left"), ("\nor", "left"), ("true one\npreferred", "right"),
        ("with the\nnext poses", "right"),
    )  # fmt: skip
    for entry in predicted:
        now, after = entry["probability_now"], entry["probability_after"]
        table.add_row(*entry["rivals"], f"{now:.2f}", f"{after:.2f}")
    return table


def _remedies(entry: dict[str, Any]) -> Iterator[RenderableType]:
    first, second = entry["rivals"]
    for remedy in entry["interventions"]:
        yield Text(f"{first} or {second}: {remedy['says']} ({remedy['probability']:.2f})")
    if entry["inseparable"]:
        yield Text(
            f"{first} or {second}: neither these poses nor any change that was tried tells them "
            "apart; on these data correct for either"
        )


def _poses(poses: list[dict[str, Any]]) -> Table:
    first = poses[0]
    shown = [(key, unit) for key, unit in (("joints_deg", "deg"), ("joints_mm", "mm"))]
    joints = [(key, unit, name) for key, unit in shown for name in first.get(key, {})]
    table = plain_table(
        ("next\npose", "left"), *((f"{name}\n{unit}", "right") for _, unit, name in joints)
    )
    for pose in poses:
        table.add_row(pose["pose"], *(f"{pose[key][name]:.2f}" for key, _, name in joints))
    return table
