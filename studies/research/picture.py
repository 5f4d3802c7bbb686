"""The picture of the README from a demonstration: ``python -m studies.research.picture FOLDER OUT``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from calib import load_cell, load_plan
from calib.files.write import write_files
from studies.figures.arm import draw_arm, placed
from studies.figures.errors import draw_steps
from studies.figures.style import panels, styled, svg
from studies.results.diagnose import DiagnoseResult
from studies.results.identify import IdentifyResult
from studies.results.read import read_as

if TYPE_CHECKING:
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


@styled
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
    figure, (left, right) = panels(9.6, 3.7, 1, 2)
    figure.set_facecolor("white")
    draw_arm(left, cell.robot, *placed(cell, load_plan(cell, folder / "plan.csv").q), _VIEW)
    left.set(aspect="equal", title="which poses to measure")
    left.set_axis_off()
    draw_steps(right, steps, diagnosed.gap.floor_mm)
    right.set_title("how far the robot is off, and why")
    return figure


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
    write_files({out: f'<?xml version="1.0"?>\n{svg(picture(folder), "picture", caption)}'})
    click.echo(f"wrote {out}")


if __name__ == "__main__":
    main()
