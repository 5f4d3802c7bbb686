"""An identification as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib import Cell, Identification
from calib.effects import GROUPS
from calib.effects.backlash import Backlash
from calib.effects.tool import Tool
from studies.noise_words import noise_words
from studies.tables import plain_table

_LABELS = {
    "fitted_all": "fitted, every pose",
    "fitted": "fitted, without the outliers",
    "nominal": "nominal (base and markers fitted)",
    "heldout": "held out",
    "heldout_trimmed": "held out, without its outliers",
}
_TOGETHER = 1.2  # ratio worth a line


def identification_tables(
    cell: Cell, result: Identification, fields: dict[str, Any]
) -> Iterator[RenderableType]:
    """Summary, errors, parameters, and what a reader should look at."""
    yield _summary(cell, result, fields)
    yield _errors(fields)
    yield _parameters(result, fields)
    yield from _notes(result, fields)


def _summary(cell: Cell, result: Identification, fields: dict[str, Any]) -> Text:
    data = result.fit.data
    noise = fields["noise"]
    lines = [
        f"{cell.name}: {result.rank} of {len(result.values)} parameters from {len(data)} poses, "
        f"{int(data.seen.sum())} points",
        f"status     {result.status}: {fields['advice']}",
        f"solved     approach {result.approach}, {result.method}"
        + (", elastic parameters from differences" if fields["differences"] else ""),
        *(f"{'noise' if not k else '':<10} {line}" for k, line in enumerate(noise_words(noise))),
        f"expected   {fields['task_rms_mm']:.4f} mm RMS, {fields['task_worst_mm']:.4f} mm at worst, "
        f"from the parameters' uncertainty at {fields['targets']}",
    ]
    return Text("\n".join(lines))


def _errors(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\ndistance measured - predicted", "left"),
        ("RMS\n[mm]", "right"),
        ("p95\n[mm]", "right"),
        ("max\n[mm]", "right"),
    )
    for key, label in _LABELS.items():
        if fields["rms_mm"][key] is not None:
            row = (fields[name][key] for name in ("rms_mm", "p95_mm", "max_mm"))
            table.add_row(label, *(f"{value:.4f}" for value in row))
    return table


def _parameters(result: Identification, fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\neffect", "left"),
        ("\nwhere", "left"),
        ("\nparameter", "left"),
        ("\nvalue", "right"),
        ("standard\ndeviation", "right"),
        ("\nunit", "left"),
    )
    for p in fields["parameters"]:
        if p["effect"] in ("base", "tool") and len(result.values) > len(GROUPS):
            continue
        std = p["std"]
        digits = 3 if std is None else max(0, 1 - int(np.floor(np.log10(std))))
        table.add_row(
            p["effect"],
            p["where"],
            p["name"],
            f"{p['value']:.{digits}f}",
            "not estimated" if std is None else f"{std:.{digits}f}",
            p["unit"],
        )
    return table


def _common_error(result: Identification) -> float:
    """Median ratio of standard deviations by pose to those by point; 1 where it cannot be told."""
    counted = result.levels is not None and result.levels.variances.any
    if result.std_by_pose is None or result.noise.source != "residual" or counted:
        return 1.0
    estimated = result.std > 0.0
    return float(np.median(result.std_by_pose[estimated] / result.std[estimated]))


def _notes(result: Identification, fields: dict[str, Any]) -> Iterator[Text]:
    for entry in fields["unidentifiable"]:
        yield Text(f"unidentifiable  {', '.join(entry['names'])}: {entry['reason']}")
    for kind, label in (("outliers", "outlier"), ("heldout_outliers", "held-out outlier")):
        for entry in fields[kind]:
            yield Text(f"{label}  {entry['pose']}: {entry['reason']}")
    if result.weak:
        yield Text(f"weak  {', '.join(result.weak)}: more uncertain than such errors are large")
    if len(result.model.where(Backlash)):
        yield Text(
            "half_width below zero is ordinary lost motion, the joint stops short of its motion; above "
            "zero it goes too far"
        )
    if result.unused:
        yield Text(f"unused  {', '.join(result.unused)}: too few markers for an orientation")
    if result.approach == "pose" and len(result.model.where(Tool)):
        yield Text(
            "the shape of the marker set comes from the same readings; its uncertainty is counted"
        )
    together = _common_error(result)
    if together > _TOGETHER:
        yield Text(
            f"points of one pose err together: counted by pose, standard deviations are {together:.1f} "
            "times these in the median (JSON: std_by_pose)"
        )
    if result.absorbed:
        yield Text(
            f"{len(result.absorbed)} constant errors are indistinguishable from those above and left "
            "out (listed in the JSON under 'absorbed')"
        )
    worst = np.nanmax(result.optimism) if np.isfinite(result.optimism).any() else None
    if worst is not None and worst > 1.05:
        yield Text(
            f"base and tool are part of these standard deviations; taken as known, as in the paper's "
            f"step 2, they would read up to {worst:.1f} times smaller"
        )
