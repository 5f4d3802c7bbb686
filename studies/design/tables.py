"""A design as short tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from doe import Design
from doe.curve import poses_that_match, stops_paying
from studies.tables import number, plain_table

_MOST_PARAMETERS = 24  # above it base and tool stand in the JSON alone
_WORTH_EXPLAINING = 0.002  # missing efficiency


def design_tables(design: Design, fields: dict[str, Any]) -> Iterator[RenderableType]:
    """Summary, poses, what they will determine, plans beside it, and what a reader should know."""
    yield _summary(design, fields)
    yield Text("")
    yield _poses(design, fields)
    yield Text("")
    yield _parameters(fields)
    yield Text("")
    if fields["against"]:
        yield _against(fields)
        yield Text("")
    if fields["curve"]:
        yield _curve(fields)
        yield _reading(design)
        yield Text("")
    for note in fields["notes"]:
        yield Text(f"note  {note}")


def _summary(design: Design, fields: dict[str, Any]) -> Text:
    candidates = fields["candidates"]
    beyond = "no plan is above" if fields["larger_is_better"] else "no plan is below"
    removed = ", ".join(f"{name} {n}" for name, n in candidates["removed_by"].items() if n)
    extra = "" if fields["extends"] is None else f" beside {fields['extends']} already measured"
    reference = fields["reference"]
    repeats = "" if reference is None else f" and {len(reference['poses'])} repeats of one"
    if fields["reapproaches"] is not None:
        repeats += f" and {len(fields['reapproaches']['again'])} second visits"
    lines = [
        f"{design.problem.cell.name}: {design.problem.request.poses} poses{repeats}{extra} for "
        f"{len(fields['predicted_std'])} parameters",
        _line(
            fields["criterion"],
            f"{number(fields['value'])} {fields['criterion_unit']}; "
            f"{beyond} {number(fields['bound'])}",
        ),
        *_proof(fields),
        _line(
            "expected",
            f"{number(fields['task_rms_mm'])} mm RMS, {number(fields['task_worst_mm'])} mm at worst,"
            f" at {fields['targets']}",
        ),
        *_losses(fields),
        _line("indices", ", ".join(f"{k} {number(v)}" for k, v in fields["observability"].items())),
        _line(
            "candidates",
            f"{candidates['feasible']} of {candidates['drawn']} feasible"
            + (f" (removed by {removed})" if removed else ""),
        ),
        _line(
            "travel",
            f"{fields['joint_travel_deg']:.0f} degrees in this order, of the joint that moves most",
        ),
    ]
    return Text("\n".join(lines))


def _line(label: str, text: str) -> str:
    return f"{label:<11} {text}"


def _percent(share: float) -> str:
    return f"{math.floor(share * 1e4) / 1e2:.2f} %"


def _proof(fields: dict[str, Any]) -> Iterator[str]:
    proof = fields["proof"]
    fresh = proof["efficiency_fresh"]
    squared = " (of the squared RMS)" if fields["criterion"].startswith("task") else ""
    if proof["proved_optimal"]:
        nodes = proof["nodes"]
        yield _line("proof", f"the best plan of these candidates (branch and bound, {nodes} nodes)")
    else:
        share = _percent(fields["efficiency"])
        yield _line("proof", f"at least {share}{squared} of the best plan of these candidates")
    if fresh is not None:
        count = fields["candidates"]["drawn"]
        yield _line("", f"and {_percent(fresh)} of the best of {count} fresh ones")
    rest = 1.0 - fields["efficiency"]
    if rest > _WORTH_EXPLAINING and not proof["proved_optimal"]:
        solver = min(proof["solver_gap"], rest)
        yield _line(
            "slack", f"{100 * solver:.2f} of the missing {100 * rest:.2f} % are the solver's,"
        )
        yield _line("", "the rest lies between the plan and the bound, which may split poses;")
        spread = 100.0 * (1.0 - proof["agreement_of_starts"])
        yield _line(
            "", f"the searches ended {spread:.2f} % apart: the closer, the more is the bound's"
        )


def _losses(fields: dict[str, Any]) -> Iterator[str]:
    pose = fields["survives"]["loss_of_pose"]
    markers = fields["survives"]["loss_of_marker"]
    if pose["task_rms_mm"] is None:
        yield _line("loss", f"of pose {pose['worst']} takes parameters with it")
    else:
        rms, kept = number(pose["task_rms_mm"]), _percent(pose["efficiency"])
        yield _line("loss", f"of pose {pose['worst']}, the worst to lose: {rms} mm RMS")
        yield _line("", f"({fields['criterion']}: at least {kept} of what any plan could keep)")
    lost = [name for name, rms in markers.items() if rms is None]
    if lost:
        yield _line("", f"of marker {', '.join(lost)} takes parameters with it")
    elif markers:
        yield _line("", f"of any one marker: up to {number(max(markers.values()))} mm RMS")


def _poses(design: Design, fields: dict[str, Any]) -> Table:
    robot = design.problem.cell.robot
    units = ["mm" if slides else "deg" for slides in robot.prismatic]
    joints = [f"{name}\n[{unit}]" for name, unit in zip(robot.joints, units, strict=True)]
    table = plain_table(("\npose", "left"), *((name, "right") for name in joints))
    for pose in fields["poses"]:
        values = {**pose["joints_deg"], **pose.get("joints_mm", {})}
        table.add_row(pose["pose"], *(f"{values[name]:.2f}" for name in robot.joints))
    return table


def _parameters(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\neffect", "left"),
        ("\nwhere", "left"),
        ("\nparameter", "left"),
        ("expected standard\ndeviation", "right"),
        ("\nunit", "left"),
    )
    for p in fields["predicted_std"]:
        if p["effect"] in ("base", "tool") and len(fields["predicted_std"]) > _MOST_PARAMETERS:
            continue
        std = "open" if p["std"] is None else f"{p['std']:.3g}"
        table.add_row(p["effect"], p["where"], p["name"], std, p["unit"])
    return table


def _against(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\nplan", "left"),
        ("\nposes", "right"),
        (f"\n{fields['criterion']}", "right"),
        ("efficiency\n(bound)", "right"),
        ("task RMS\n[mm]", "right"),
        ("trace of\ncovariance", "right"),
        ("det(M)\n^(1/p)", "right"),
    )
    own = {**fields, "poses": len(fields["poses"])}
    for name, plan in {"this plan": own, **fields["against"]}.items():
        keys = ("value", "efficiency", "task_rms_mm", "trace", "determinant")
        table.add_row(name, str(plan["poses"]), *(number(plan[key]) for key in keys))
    return table


def _curve(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\nposes", "right"),
        (f"\n{fields['criterion']}", "right"),
        ("task RMS\n[mm]", "right"),
        ("efficiency\n(bound)", "right"),
    )
    for step in fields["curve"]:
        keys = ("value", "task_rms_mm", "efficiency")
        table.add_row(str(step["poses"]), *(number(step[key]) for key in keys))
    return table


def _reading(design: Design) -> Text:
    enough = stops_paying([s.poses for s in design.curve], [s.task_rms for s in design.curve])
    lines = [
        f"from {enough} poses on, more only average noise: twice as many for a third less error",
        "(plans before polishing: the one above is a little better than its line here)",
    ]
    for name, count in poses_that_match(design.curve, design).items():
        said = f"{count} poses do" if count else "no plan of this range does"
        lines.append(f"{said} as well as {name} with its {design.rivals[name].poses}")
    return Text("\n".join(lines))
