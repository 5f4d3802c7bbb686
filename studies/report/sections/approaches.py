"""Both approaches of the paper side by side, predicted and simulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from studies.plots import deviations
from studies.report.evidence import Evidence, Result
from studies.report.parts import Figure, Part, Section, Table, Text

_NAMES = {
    ("points", "full"): "#2 points",
    ("pose", "full"): "#1 pose, full covariance",
    ("pose", "normalised"): "#1 pose, normalised",
    ("pose", "plain"): "#1 pose, plain",
}
_DRAWN = 20  # plans that a figure can keep apart; the table holds them all


def approaches(evidence: Evidence, result: Result) -> Section:
    """Errors expected and simulated, and each parameter's standard deviation."""
    return Section("approaches", "Both approaches side by side", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    yield Text(
        "Approach #2 uses the marker coordinates as measured; approach #1 computes position and "
        "orientation of the tool from them first. Weighted by its full covariance #1 loses nothing."
    )
    rows = [
        (
            plan["plan"], plan["poses"], _name(own), own["task_rms_mm"], own["task_worst_mm"],
            own["monte_carlo_task_rms_mm"],
            None if own["agreement"] is None else own["agreement"]["chi2_p"],
        )
        for plan in fields["plans"]
        for own in plan["approaches"]
    ]  # fmt: skip
    yield Table(
        (
            "plan", "poses", "approach", "expected RMS [mm]", "at worst [mm]", "simulated [mm]", "p",
        ),
        rows,
        f"Error expected at {fields['targets']}, and in {fields['trials']} simulated "
        "experiments; p is the chance of a scatter as far from the prediction",
    )  # fmt: skip
    said = fields["agreement"]["says"]
    yield Text(
        f"{said[0].upper()}{said[1:]}.",
        "warn" if fields["agreement"]["believed"] is False else "good",
    )
    if 1 < len(fields["plans"]) <= _DRAWN:
        shared = [plan for plan in fields["plans"] if _ids(plan) == _ids(fields["plans"][0])]
        yield Figure(
            deviations.by_approach(
                *_named(fields["plans"][0]),
                {plan["plan"]: _std(points_of(plan)) for plan in shared},
                name="plans",
                title="Standard deviations by plan, approach #2",
            )
        )
    yield from _of_plan(fields["plans"][0])
    for note in fields["notes"]:
        yield Text(note, "note")


def _of_plan(plan: dict[str, Any]) -> Iterator[Part]:
    names, units = _named(plan)
    ways = {_key(own): own for own in plan["approaches"]}
    predicted = {key: _std(own) for key, own in ways.items()}
    picture = deviations.by_approach(names, units, predicted)
    yield Figure(replace(picture, title=f"{plan['plan']}: {picture.title}"))
    simulated = {
        key: _std(own, "monte_carlo_std")
        for key, own in ways.items()
        if own["agreement"] is not None
    }
    if simulated:
        both = {key: predicted[key] for key in simulated}
        picture = deviations.predicted_against_simulated(
            names, units, both, simulated, plan["trials"]
        )
        yield Figure(replace(picture, title=f"{plan['plan']}: {picture.title}"))


def _ids(plan: dict[str, Any]) -> list[str]:
    return [p["id"] for p in plan["approaches"][0]["parameters"]]


def _named(plan: dict[str, Any]) -> tuple[list[str], list[str]]:
    return _ids(plan), [p["unit"] for p in plan["approaches"][0]["parameters"]]


def points_of(plan: dict[str, Any]) -> dict[str, Any]:
    """Approach #2 of a plan. Raises KeyError where it is missing."""
    found: dict[str, Any] = {own["approach"]: own for own in plan["approaches"]}["points"]
    return found


def _std(own: dict[str, Any], key: str = "std") -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([p[key] for p in own["parameters"]], dtype=np.float64)


def _key(own: dict[str, Any]) -> str:
    return "points" if own["approach"] == "points" else f"pose {own['weighting']}"


def _name(own: dict[str, Any]) -> str:
    return _NAMES.get((own["approach"], own["weighting"] or "full"), str(own["approach"]))
