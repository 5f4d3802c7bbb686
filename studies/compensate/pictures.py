"""The error at each target, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from studies.plots.style import (
    BLUE,
    PANEL,
    VERMILLION,
    Cell,
    Picture,
    legend_below,
    log_ticks,
    pose_ticks,
    sheet,
    short,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from studies.compensate.record import CompensateRecord

_LEAST = 1e-6  # mm: below it an error is drawn as none


@styled
def errors_by_target(record: CompensateRecord) -> Picture:
    """By how much each target is missed, with its nominal and with its corrected command."""
    names = [target.pose for target in record.targets]
    before = np.array([target.before_mm for target in record.targets])
    expected = np.array([target.expected_mm for target in record.targets])
    at = np.arange(len(names))
    figure = sheet(PANEL, 3.8)
    panel = figure.subplots()
    tidy(panel, "y")
    panel.set_yscale("log")
    lines = [
        *panel.plot(at, np.maximum(before, _LEAST), color=VERMILLION, marker="^", linestyle="",
                    label="nominal command"),
        *panel.plot(at, np.maximum(expected, _LEAST), color=BLUE, marker="o", linestyle="",
                    label="corrected command, expected"),
    ]  # fmt: skip
    low, high = _limits(np.concatenate([before, expected]))
    log_ticks(panel.yaxis, low, high)
    panel.set(xlabel="target", ylabel="error at the target [mm]", ylim=(low, high))
    pose_ticks(panel, names)
    legend_below(figure, lines)
    caption = (
        "By how much the arm misses each target with its nominal command, and is expected to with its "
        "corrected one: what is left is the parameters' uncertainty, what the model lacks, and what "
        "the arm cannot reach."
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (t.pose, t.before_mm, t.left_mm, t.expected_mm, t.limited_by) for t in record.targets
    )
    header = ("target", "before [mm]", "left [mm]", "expected [mm]", "limited by")
    return Picture("errors_by_target", _title(record), caption, figure, header, rows)


def _title(record: CompensateRecord) -> str:
    was, now = (short(value, 2) for value in (record.rms_mm.before, record.rms_mm.expected))
    return f"Error at each target: {was} mm RMS before, {now} mm expected after correction"


def _limits(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, float]:
    """Room around what is drawn, on a scale of powers."""
    shown = np.maximum(values, _LEAST)
    return float(shown.min()) / 1.6, float(shown.max()) * 1.6
