"""Half-way through a plan: are the poses enough, and which come next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.enough.tables import beyond_reach, shares
from studies.report.evidence import Evidence, Result
from studies.report.parts import Part, Section, Table, Text, folded, listed


def progress(evidence: Evidence, result: Result) -> Section:
    """What is known now, at the end of the plan, and pose by pose."""
    return Section("progress", "Are the poses enough?", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    plan, goal = fields["plan"], fields["goal_mm"]
    if plan["poses"]:
        yield Text(
            f"{plan['measured']} of {plan['poses']} planned poses are measured. Expected now: "
            f"{_mm(fields['now'])}; at the end of the plan: {_mm(fields['end'])}."
        )
    else:
        yield Text(f"Expected after {fields['now']['readings']} readings: {_mm(fields['now'])}.")
    for line in shares(fields) if "lacking" in fields else ():
        yield Text(f"{line[0].upper()}{line[1:]}.")
    if fields.get("goal_beyond_reach"):
        why = beyond_reach(fields["lacking"])
        yield Text(f"No number of poses reaches the goal of {goal:g} mm: {why}.", "warn")
    elif goal is not None:
        needed, fresh = fields["poses_to_goal"], fields["fresh_poses_to_goal"]
        more = f"; about {fresh} fresh poses more would do" if fresh else ""
        reached = {None: f"is not reached by these poses{more}", 0: "is reached: you may stop"}
        said = reached.get(needed, f"is reached after {needed} more pose{'s' * (needed != 1)}")
        yield Text(f"The goal of {goal:g} mm {said}.", "warn" if needed is None else "good")
    rows = [
        (step["pose"], step["task_rms_mm"], step["task_worst_mm"], listed(step["unidentifiable"]))
        for step in fields["order"]
    ]
    if rows:
        yield Table(
            ("measure next", "expected RMS [mm]", "at worst [mm]", "still open"),
            rows,
            "In the order that pays most",
            fold=folded("Poses to come", rows),
        )


def _mm(step: dict[str, Any]) -> str:
    rms = step["task_rms_mm"]
    return "some parameters open" if rms is None else f"{rms:.4f} mm RMS"
