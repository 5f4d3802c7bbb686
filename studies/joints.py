"""Joint values in the units of the file formats: in records, and as columns of tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from pydantic import Field

from studies.document import JOINT, Column, Rule
from studies.record import Entry, Number

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array


class JointValues(Entry):
    """An entry of a record that stands at joint values, by the joints' names."""

    joints_deg: dict[str, Number]
    joints_mm: dict[str, Number] = Field(default_factory=dict)


def shown_joints(robot: Robot, q: Array, what: str = "") -> dict[str, dict[str, float]]:
    """Joint values, shape (n,), rad or m, as the fields of :class:`JointValues`.

    what : before the names of the fields, as in ``nominal_joints_deg``
    """
    found: dict[str, dict[str, float]] = {f"{what}joints_deg": {}, f"{what}joints_mm": {}}
    for joint, slides, value in zip(robot.joints, robot.prismatic, q.tolist(), strict=True):
        shown = value * 1e3 if slides else math.degrees(value)
        found[f"{what}joints_{'mm' if slides else 'deg'}"][joint] = round(shown, 6) + 0.0
    return found


def check_same_joints(rows: Sequence[JointValues]) -> None:
    """Raise ValueError where an entry has other joints than the first."""
    names = {(frozenset(row.joints_deg), frozenset(row.joints_mm)) for row in rows}
    if len(names) > 1:
        raise ValueError("its poses have not all the same joints")


def joint_columns(
    rows: Sequence[JointValues], rule: Rule = JOINT, *, detail: bool = True
) -> tuple[Column[JointValues], ...]:
    """A column for each joint; detail : whether they are for the page only."""
    turning = rows[0].joints_deg if rows else {}
    sliding = rows[0].joints_mm if rows else {}
    return (
        *(Column(name, _turned(name), rule, "deg", detail) for name in turning),
        *(Column(name, _slid(name), rule, "mm", detail) for name in sliding),
    )


def _turned(name: str) -> Callable[[JointValues], float]:
    return lambda row: row.joints_deg[name]


def _slid(name: str) -> Callable[[JointValues], float]:
    return lambda row: row.joints_mm[name]
