"""A plan: its poses, the proof of how good they are, what they will determine."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from studies.report.evidence import Evidence, Result
from studies.report.parts import Part, Section, Table, Text, folded, joint_columns, shown


def plan(evidence: Evidence, result: Result) -> Section:
    """The certificate in words, the poses, the deviations they promise, and plans beside it."""
    return Section("plan", "The plan and its proof", tuple(_parts(result.fields)))


def _parts(fields: Mapping[str, Any]) -> Iterator[Part]:
    yield Text(certificate(fields), "good")
    yield Text(
        "The proof needs no trust in the search that found the plan: the criterion is concave in the "
        "information of a plan, so its slope at any point bounds all plans at once. What is missing to "
        "100 % is mostly slack of the bound, which may use half a pose where a plan cannot."
    )
    yield Table(("", ""), list(_facts(fields)))
    yield _poses(fields)
    if fields["against"]:
        yield _against(fields)
    yield _deviations(fields)
    for note in fields["notes"]:
        yield Text(note, "note")


def certificate(fields: Mapping[str, Any]) -> str:
    """The proof as a sentence."""
    squared = " (of the squared RMS)" if fields["criterion"].startswith("task") else ""
    if fields["proof"]["proved_optimal"]:
        return "No plan from these candidates is better: proved by branch and bound."
    share = math.floor(fields["efficiency"] * 1e3) / 10.0
    fresh = fields["proof"]["efficiency_fresh"]
    return (
        f"This plan reaches at least {share:.1f} %{squared} of what the best plan of the same size "
        f"from {fields['candidates']['feasible']} candidates could"
        + (
            ""
            if fresh is None
            else f", and {math.floor(fresh * 1e3) / 10.0:.1f} % of the best of fresh candidates"
        )
        + "."
    )


def _facts(fields: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    unit, removed = fields["criterion_unit"], fields["candidates"]["removed_by"]
    yield "criterion", f"{fields['criterion']}: {shown(fields['value'])} {unit}"
    yield "no plan is better than", f"{shown(fields['bound'])} {unit}"
    yield (
        f"expected after measuring {size(fields)}",
        f"{shown(fields['task_rms_mm'])} mm RMS, {shown(fields['task_worst_mm'])} mm at worst, at "
        f"{fields['targets']}",
    )
    lost = fields["survives"]["loss_of_pose"]
    if lost["worst"] is not None:
        yield (
            f"should pose {lost['worst']} be lost, the worst to lose",
            "parameters are lost with it"
            if lost["task_rms_mm"] is None
            else f"{shown(lost['task_rms_mm'])} mm RMS",
        )
    for name, rms in fields["survives"]["loss_of_marker"].items():
        said = "parameters are lost with it" if rms is None else f"{shown(rms)} mm RMS"
        yield f"should marker {name} be lost", said
    said = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in removed.items() if n)
    yield (
        "candidates",
        f"{fields['candidates']['feasible']} of {fields['candidates']['drawn']} allowed"
        + (f"; removed by {said}" if said else ""),
    )
    yield (
        "observability indices",
        ", ".join(f"{name} {shown(value)}" for name, value in fields["observability"].items()),
    )


def _poses(fields: Mapping[str, Any]) -> Part:
    poses = fields["poses"]
    joints = joint_columns(poses)
    leveled = any(pose["level"] is not None for pose in poses)
    rows = [
        (
            pose["pose"],
            *(f"{pose[key][name]:.2f}" for _, key, name in joints),
            *([shown(pose["level"])] if leveled else []),
        )
        for pose in poses
    ]
    header = ("pose", *(title for title, _, _ in joints), *(["level"] if leveled else []))
    return Table(
        header,
        rows,
        "Poses, in the order of measuring",
        of_poses=True,
        fold=folded("The poses", rows),
    )


def size(fields: Mapping[str, Any]) -> str:
    """How many poses were chosen, and how often one of them is repeated as a reference."""
    count, again = chosen(fields), len(fields["poses"]) - chosen(fields)
    if not again:
        return f"{count} poses"
    return f"{count} poses, one of them measured {again} times more as a reference"


def chosen(fields: Mapping[str, Any]) -> int:
    """Poses that the proof speaks of: without the repeats of the reference pose."""
    reference = fields.get("reference") or {"poses": []}
    return len(fields["poses"]) - len(reference["poses"])


def _against(fields: Mapping[str, Any]) -> Part:
    keys = ("value", "efficiency", "task_rms_mm")
    rows = [("this plan", chosen(fields), *(fields[key] for key in keys))]
    rows += [
        (name, own["poses"], *(own[key] for key in keys)) for name, own in fields["against"].items()
    ]
    return Table(
        ("plan", "poses", fields["criterion"], "share of the bound", "expected RMS [mm]"),
        rows,
        "Plans judged by the same bound",
    )


def _deviations(fields: Mapping[str, Any]) -> Part:
    rows = [
        (
            p["effect"],
            p["where"],
            p["name"],
            "open" if p["std"] is None else f"{p['std']:.3g}",
            p["unit"],
        )
        for p in fields["predicted_std"]
    ]
    return Table(
        ("effect", "where", "parameter", "standard deviation", "unit"),
        rows,
        "What the plan will determine, base and tool included",
        fold=folded("Expected standard deviations", rows),
    )
