"""The expected error over the poses to come."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from studies.plots import style

if TYPE_CHECKING:
    from studies.enough.record import EnoughRecord


@style.styled
def expected_by_pose(record: EnoughRecord) -> style.Picture:
    """What is expected now and after each pose of the order, beside the goal and what stays."""
    steps = (record.now, *record.order)
    names = ["now", *(step.pose or "" for step in record.order)]
    at = np.arange(len(steps))
    rms = np.array([step.task_rms_mm for step in steps], dtype=float)
    most = np.array([step.task_most_mm for step in steps], dtype=float)
    figure = style.sheet(style.PANEL, 3.8)
    panel = figure.subplots()
    style.tidy(panel, "y")
    lines = [
        *panel.plot(at, most, color=style.VERMILLION, marker="^", linestyle="--",
                    label="19 times in 20 below"),
        *panel.plot(at, rms, color=style.BLUE, marker="o", label="expected RMS"),
    ]  # fmt: skip
    if record.goal_mm is not None:
        lines.append(panel.axhline(record.goal_mm, color=style.INK, linestyle="-.", label="goal"))
    if record.lacking.rms_mm:
        label = "what no pose lowers"
        lines.append(
            panel.axhline(record.lacking.rms_mm, color=style.SOFT, linestyle=":", label=label)
        )
    panel.set(xlabel="after which pose", ylabel="error at the targets [mm]", ylim=(0.0, None))
    style.pose_ticks(panel, names)
    style.legend_below(figure, lines)
    caption = (
        "The error expected at the targets now and after each pose still to come, in the order that "
        "pays most, and what it exceeds once in twenty."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (name, float(step.readings), step.task_rms_mm, step.task_worst_mm, step.task_most_mm)
        for name, step in zip(names, steps, strict=True)
    )
    header = ("after", "readings", "task RMS [mm]", "worst [mm]", "19 in 20 below [mm]")
    title = "What the poses still to come would bring: expected error at the targets"
    return style.Picture("expected_by_pose", title, caption, figure, header, rows)
