"""The picture of the README from a demonstration: ``python -m studies.research.picture FOLDER OUT``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from scipy.spatial import ConvexHull

from calib import Cell, load_cell, load_plan
from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.write import write_files
from studies.identify.record import IdentifyRecord
from studies.plots.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    SOFT,
    VERMILLION,
    Picture,
    log_ticks,
    sheet,
    styled,
    svg_text,
    tidy,
)
from studies.report.arm_drawing import Viewpoint
from studies.results.read import read_as

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VIEW = Viewpoint(-58.0, 18.0)
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_DISC = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
_RADII = 0.02, 0.016  # of the two ends of a link, shares of the reach


@styled
def picture(folder: Path) -> Picture:
    """The arm at the planned poses, and how far prediction and measurement are apart, step by step."""
    cell = load_cell(folder / "cell.toml")
    identified = read_as(folder / "identify.json", IdentifyRecord)
    diagnosed = json.loads((folder / "diagnose.json").read_text("utf-8"))
    gap, nominal = diagnosed["gap"], identified.error.before
    cause = diagnosed["effects"][0]
    steps = (
        ("as delivered", nominal, VERMILLION),
        ("identified", identified.rms_mm.heldout, BLUE),
        (f"{cause['effect'].replace('_', ' ')}\nfound and added", gap["heldout_after_mm"], GREEN),
    )
    figure = sheet(9.6, 3.7)
    left, right = figure.subplots(1, 2, width_ratios=(1.05, 1.0))
    _arms(left, cell, load_plan(cell, folder / "plan.csv").q)
    _errors(right, steps, gap["floor_mm"])
    caption = (
        f"Left: the fifteen poses that posecal chose for {cell.name}. Right: distance between measured "
        "and predicted points at poses that took no part, as delivered, after identification, and with "
        "the error that the diagnosis found."
    )
    rows = tuple((label.replace("\n", " "), value) for label, value, _ in steps)
    return Picture("picture", "What posecal does", caption, figure, ("step", "RMS [mm]"), rows)


def _arms(panel: Axes, cell: Cell, q: Array) -> None:
    """Every pose as a line, the first one as a body; nearer links over farther ones."""
    panel.set_aspect("equal")
    panel.set_axis_off()
    origins = forward(cell.robot, q).o
    low, high = origins.min(axis=(0, 1)) - 0.1, origins.max(axis=(0, 1)) + 0.1
    floor = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    _fill(panel, _VIEW.flat(np.array([(*corner, 0.0) for corner in floor])), 0.5, "0.975", "0.8")
    for points in origins[1:]:
        panel.plot(*_VIEW.flat(points).T, color=SOFT, linewidth=1.0, zorder=5.0, alpha=0.7)
        panel.plot(*_VIEW.flat(points[-1:]).T, marker="o", markersize=4.0, color=BLUE, zorder=6.0)
    reach = cell.robot.reach
    for link in zip(origins[0][:-1], origins[0][1:], strict=True):
        ends = np.array(link)
        if np.linalg.norm(ends[1] - ends[0]) > 0.01 * reach:
            discs = [
                end + r * reach * _DISC for end, r in zip(_VIEW.flat(ends), _RADII, strict=True)
            ]
            cloud = np.concatenate(discs)
            outline = cloud[ConvexHull(cloud).vertices]
            _fill(panel, outline, 30.0 + _order(ends), "0.86", INK)
    tip = _VIEW.flat(origins[0][-1])
    _fill(panel, tip + 0.013 * reach * _DISC, 40.0 + _order(origins[0][-1]), BLUE, INK)
    panel.set_title("which poses to measure", loc="left")


def _order(points: Array) -> float:
    """Drawing order of what stands at these points: nearer is higher."""
    return 10.0 + float(np.mean(np.asarray(points, dtype=float) @ _VIEW.axes[2]))


def _fill(panel: Axes, corners: Array, order: float, face: str, edge: str) -> None:
    panel.fill(*corners.T, facecolor=face, edgecolor=edge, linewidth=0.8, zorder=order)


def _errors(panel: Axes, steps: Any, floor: float) -> None:
    tidy(panel, "y")
    for at, (_, value, color) in enumerate(steps):
        panel.bar(at, value, 0.56, color=color, bottom=0.0)
        panel.annotate(
            f"{value:.3f} mm", (at, value), (0, 4), textcoords="offset points", ha="center"
        )
    panel.axhline(floor, color=INK, linewidth=1.2, linestyle=(0, (4, 2)))
    last = len(steps) - 1
    panel.annotate("noise of\nthe tracker", (last + 0.36, floor), (0, -4), textcoords="offset points",
                   ha="left", va="top", color=SOFT, fontsize=9)  # fmt: skip
    low, high = 0.4 * floor, 2.5 * steps[0][1]
    panel.set(yscale="log", ylim=(low, high), ylabel="RMS error at held-out poses [mm]")
    panel.set_xlim(-0.5, last + 1.05)  # room for the name of the line
    log_ticks(panel.yaxis, low, high)
    panel.set_xticks(range(len(steps)), [label for label, _, _ in steps])
    panel.tick_params(axis="x", length=0)
    panel.grid(True, axis="y", color=FAINT, linewidth=0.6)
    panel.set_title("how far the robot is off, and why", loc="left")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
def main(folder: Path, out: Path) -> None:
    """Draw the picture of the README from the results of ``posecal demo`` in FOLDER."""
    write_files({out: svg_text(picture(folder))})
    click.echo(f"wrote {out}")


if __name__ == "__main__":
    main()
