"""A comparison as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.compare import Comparison
from studies.plots.style import APPROACHES
from studies.tables import number, plain_table

_MOST_PARAMETERS = 24  # above it base and tool stand in the JSON alone
_SAME = 1.005
_TITLES = ("#1\nplain", "#1\nnorm.", "#1\nfull", "#2\npoints")


def comparison_tables(result: Comparison, fields: dict[str, Any]) -> Iterator[RenderableType]:
    """The answer, accuracy of every way at every plan, and standard deviations of the parameters.

    One plan is shown under every approach, several under approach #2 side by side.
    """
    yield _answer(result, fields)
    yield Text("")
    yield _accuracy(fields)
    plans = fields["plans"]
    if len(plans) == 1:
        loses = ", and what plain #1 loses" if plans[0]["improvement"] else ""
        yield Text(f"\nstandard deviations{loses}", style="bold")
        yield _approaches(plans[0], fields["trials"] > 1)
    else:
        yield Text("\nstandard deviations of approach #2 at each plan", style="bold")
        yield _side_by_side(plans)
    yield from _left_out(plans)
    for note in fields["notes"]:
        yield Text(f"note  {note}")


def _answer(result: Comparison, fields: dict[str, Any]) -> Text:
    plans = fields["plans"]
    p = len(plans[0]["approaches"][0]["parameters"])
    simulated = _count(fields["trials"], "simulated experiment")
    each = " each" if len(plans) > 1 and len({plan["trials"] for plan in plans}) == 1 else ""
    lines = [
        f"{result.cell.name}: {p} parameters, {_count(len(plans), 'plan')}, "
        + (f"{simulated}{each}" if fields["trials"] else "not simulated"),
        *_best(plans, f"{fields['targets']}, at the {fields['task_at']}"),
        *_gain(plans),
        *_belief(fields),
        *_interrupted(fields),
        *_hidden(plans),
        *_open(plans),
    ]
    return Text("\n".join(lines))


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _best(plans: list[dict[str, Any]], targets: str) -> Iterator[str]:
    """The plan that leaves the smallest error, and what the others need to draw level."""
    rms = {plan["plan"]: _entry(plan, "points")["task_rms_mm"] for plan in plans}
    known = {name: value for name, value in rms.items() if np.isfinite(value)}
    if not known:
        yield "best       no plan determines every parameter"
        return
    best = min(known, key=lambda name: known[name])
    yield f"best       {best} with approach points: {known[best]:.4g} mm RMS expected at {targets}"
    for name, value in known.items():
        if name != best and value > _SAME * known[best]:
            times = (value / known[best]) ** 2
            yield f"           {name} would have to be measured {times:.2f} times over to match it"


def _gain(plans: list[dict[str, Any]]) -> Iterator[str]:
    if all(_entry(plan, "pose") is None for plan in plans):
        yield "approach   #1 (pose) needs three visible markers that are not in line; #2 does not"
        return
    factors = [e["factor"] for plan in plans for e in plan["improvement"]]
    factors = [f for f in factors if np.isfinite(f)]
    if not factors:
        return
    yield (
        f"approach   #1 with plain weighting is {min(factors):.2f} to {max(factors):.3g} times less "
        "certain than #2"
    )
    worst = max(_loss(plan) for plan in plans)
    yield "           weighted by its full covariance #1 " + (
        "equals #2: the gain is in the weighting"
        if worst < _SAME
        else f"still is up to {worst:.2f} times less certain: it computes the marker geometry first"
    )


def _loss(plan: dict[str, Any]) -> float:
    """Largest ratio of standard deviations, fully weighted #1 over #2."""
    full, points = _entry(plan, "pose"), _entry(plan, "points")
    if full is None:
        return 1.0
    ratios = [
        a["std"] / b["std"] for a, b in zip(full["parameters"], points["parameters"], strict=True)
    ]
    same = all(
        np.isnan(a["std"]) == np.isnan(b["std"])
        for a, b in zip(full["parameters"], points["parameters"], strict=True)
    )
    return float(np.nanmax([1.0, *ratios])) if same else 1.0


def _belief(fields: dict[str, Any]) -> Iterator[str]:
    found = fields["agreement"]
    if not fields["trials"]:
        return
    yield f"believe    {found['says']}"
    if found["chi2_p"] is not None:
        low, high = found["worst_ratio_band99"]
        p = found["chi2_p"]
        yield (
            f"           simulated / predicted is {found['worst_ratio']:.2f} where it is farthest from "
            f"one ({low:.2f} to {high:.2f} is chance among {found['ratios']}); p = {p:.2g}"
        )
    drawn = "MuJoCo's arm" if fields["truth"] == "mujoco" else "the model that is fitted"
    yield f"           readings drawn from {drawn}"
    yield f"           {_from_scratch(fields['plans'])}"
    for plan in fields["plans"]:
        for entry in plan["approaches"]:
            if entry["not_converged"]:
                yield (
                    f"           {entry['not_converged']} of {plan['trials']} fits of {_label(entry)} "
                    f"did not settle at {plan['plan']} and are left out"
                )


def _from_scratch(plans: list[dict[str, Any]]) -> str:
    """How many trials were identified as real data are, and where that led."""
    done = [e["from_scratch"] for plan in plans for e in plan["approaches"] if e["from_scratch"]]
    if not done:
        return "none identified from scratch"
    trials, same, out = (sum(d[key] for d in done) for key in ("trials", "same", "with_outliers"))
    return (
        f"of {_count(trials, 'fit')} as real data are, {same} end where the refits do, "
        f"{out} set poses aside"
    )


def _interrupted(fields: dict[str, Any]) -> Iterator[str]:
    for plan in fields["plans"]:
        if plan["trials"] < fields["trials_asked"]:
            done = f"{plan['trials']} of {fields['trials_asked']} experiments"
            yield f"interrupted {plan['plan']}: {done} simulated"


def _hidden(plans: list[dict[str, Any]]) -> Iterator[str]:
    for plan in plans:
        if plan["hidden_markers"]:
            lost = plan["readings_without_pose"]
            yield (
                f"hidden     {plan['hidden_markers']} marker readings at {plan['plan']}"
                + (f"; {_count(lost, 'reading')} too few for approach #1" if lost else "")
            )


def _open(plans: list[dict[str, Any]]) -> Iterator[str]:
    for plan in plans:
        names = [e["id"] for e in _entry(plan, "points")["parameters"] if np.isnan(e["std"])]
        if names:
            shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
            yield f"open       {plan['plan']} does not determine {shown}:"
            yield "           what it says of the others, simulation too, takes these as nominal"


def _left_out(plans: list[dict[str, Any]]) -> Iterator[RenderableType]:
    """What the tables do not show."""
    points = _entry(plans[0], "points")["parameters"]
    if len(points) > _MOST_PARAMETERS and any(p["effect"] in ("base", "tool") for p in points):
        yield Text("base and tool stand in the JSON")
    first = [p["id"] for p in points]
    for plan in plans[1:]:
        if [p["id"] for p in _entry(plan, "points")["parameters"]] != first:
            yield Text(f"{plan['plan']} has other parameters, see the JSON")


def _entry(plan: dict[str, Any], approach: str, weighting: str = "full") -> Any:
    found = (
        e for e in plan["approaches"] if (e["approach"], e["weighting"]) == (approach, weighting)
    )
    return next(found, None)


def _label(entry: dict[str, Any]) -> str:
    key = "points" if entry["approach"] == "points" else f"pose {entry['weighting']}"
    length = entry["length_mm"]
    return APPROACHES[key].label + ("" if length is None else f" ({length:g} mm)")


def _accuracy(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\nplan", "left"),
        ("\nposes", "right"),
        ("\napproach", "left"),
        ("task RMS\n[mm]", "right"),
        ("at worst\n[mm]", "right"),
        ("task RMS,\nsimulated", "right"),
        ("\np", "right"),
    )
    for plan in fields["plans"]:
        head = (plan["plan"], str(plan["poses"]))
        for entry in plan["approaches"]:
            keys = ("task_rms_mm", "task_worst_mm", "monte_carlo_task_rms_mm")
            found = entry["agreement"]
            chance = "-" if found is None else f"{found['chi2_p']:.2g}"
            table.add_row(*head, _label(entry), *(number(entry[key]) for key in keys), chance)
            head = ("", "")
    return table


def _approaches(plan: dict[str, Any], simulated: bool) -> Table:
    entries = plan["approaches"]
    factors, points = (
        [e["factor"] for e in plan["improvement"]],
        _entry(plan, "points")["parameters"],
    )
    columns = {
        title: [p["std"] for p in entry["parameters"]]
        for title, entry in zip(_TITLES[-len(entries) :], entries, strict=True)
        if entry["weighting"] != "full" or entry["approach"] == "points" or _loss(plan) > _SAME
    }
    if simulated:
        columns["#2\nsim."] = [p["monte_carlo_std"] for p in points]
    return _parameters(plan, columns, {"plain\nover #2": factors} if factors else {})


def _side_by_side(plans: list[dict[str, Any]]) -> Table:
    """Plans beside the first; those whose model has other angles are in the JSON alone."""
    first = [p["id"] for p in _entry(plans[0], "points")["parameters"]]
    columns = {}
    for plan in plans:
        own = _entry(plan, "points")["parameters"]
        if [p["id"] for p in own] == first:
            columns[f"\n{plan['plan']}"] = [p["std"] for p in own]
    return _parameters(plans[0], columns, {})


def _parameters(
    plan: dict[str, Any], columns: dict[str, list[float]], factors: dict[str, list[float]]
) -> Table:
    """Standard deviations and ratios by parameter, effect by effect."""
    points = _entry(plan, "points")["parameters"]
    table = plain_table(
        ("\nparameter", "left"),
        ("\nunit", "left"),
        *((title, "right") for title in (*columns, *factors)),
    )
    group = ""
    for i, p in enumerate(points):
        if p["effect"] in ("base", "tool") and len(points) > _MOST_PARAMETERS:
            continue
        if p["effect"] != group:
            group = p["effect"]
            table.add_row(Text(group, style="italic"))
        table.add_row(
            f"  {p['where']} {p['name'].replace('compliance@', '@')}",
            p["unit"],
            *(_std(values[i]) for values in columns.values()),
            *("-" if np.isnan(v[i]) else f"{v[i]:.2f}" for v in factors.values()),
        )
    return table


def _std(value: float) -> str:
    return "open" if np.isnan(value) else f"{value:.3g}"
