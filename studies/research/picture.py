"""The picture of the README from a demonstration: ``python -m studies.research.picture FOLDER OUT``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from calib import load_cell, load_plan
from calib.files.write import write_files
from studies.figures import style
from studies.figures.arm import draw_arm, placed
from studies.results.diagnose import DiagnoseResult
from studies.results.identify import IdentifyResult
from studies.results.read import read_as

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = np.radians([-58.0, 18.0])  # of the viewer
_VIEW = np.array(
    [
        [-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0],
        [
            -np.sin(_ELEVATION) * np.cos(_AZIMUTH),
            -np.sin(_ELEVATION) * np.sin(_AZIMUTH),
            np.cos(_ELEVATION),
        ],
    ]
)


@style.styled
def picture(folder: Path) -> Figure:
    """The arm at the planned poses, and how far prediction and measurement are apart, step by step."""
    cell = load_cell(folder / "cell.toml")
    identified = read_as(folder / "identify.json", IdentifyResult)
    diagnosed = read_as(folder / "diagnose.json", DiagnoseResult)
    cause = diagnosed.effects[0].effect.replace("_", " ")
    steps = (
        ("as delivered", identified.error.before),
        ("identified", identified.error.after),
        (f"{cause}\nfound and added", diagnosed.error.after),
    )
    figure, (left, right) = style.panels(9.6, 3.7, 1, 2)
    figure.set_facecolor("white")
    draw_arm(left, cell.robot, *placed(cell, load_plan(cell, folder / "plan.csv").q), _VIEW)
    left.set(aspect="equal", title="which poses to measure")
    left.set_axis_off()
    draw_steps(right, steps, diagnosed.gap.floor_mm)
    right.set_title("how far the robot is off, and why")
    return figure


def draw_steps(panel: Axes, steps: Sequence[tuple[str, float]], floor: float) -> None:
    """Errors after each step of a calibration, mm, on a log axis; floor : noise alone, mm."""
    for row, (_, value) in enumerate(steps):
        color = style.BLUE if row else style.VERMILLION
        panel.plot(
            [floor / 2.0, value], [row, row], color=color, linewidth=9.0, solid_capstyle="butt"
        )
        panel.annotate(
            f"{value:#.2g} mm", (value, row), (6, 0), textcoords="offset points", va="center"
        )
    panel.axvline(floor, color=style.INK, linewidth=1.2, linestyle=style.DASHED)
    panel.annotate(
        "noise", (floor, -0.62), (5, 0), textcoords="offset points", va="center", color=style.SOFT
    )
    style.log_axis(panel.xaxis, [floor / 2.0, 3.0 * max(value for _, value in steps)])
    panel.set_yticks(range(len(steps)), [label for label, _ in steps])
    panel.set(ylim=(len(steps) - 0.4, -0.75), xlabel="RMS error at held-out poses [mm]")
    panel.grid(False, axis="y")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
def main(folder: Path, out: Path) -> None:
    """Draw the picture of the README from the results of ``posecal demo`` in FOLDER."""
    caption = (
        "Left: the poses that posecal chose. Right: distance between measured and predicted points at "
        "poses that took no part, as delivered, after identification, and with the error that the "
        "diagnosis found."
    )
    write_files({out: f'<?xml version="1.0"?>\n{style.svg(picture(folder), "picture", caption)}'})
    click.echo(f"wrote {out}")


if __name__ == "__main__":
    main()
