"""Counterparts of the paper's Figures 1 to 4: ``python -m studies.research.paper.figures FOLDER``.

The paper's Figures 1, 3 and 4 are photographs. Here everything stands where the model has it: frames
and joints of the URDF, markers of Table III, a configuration of Table II, the deflection under 250 kg.
Bodies around these points (links, bracket, stand) are only indicated.
"""

from __future__ import annotations

from pathlib import Path

import click

from calib.files.write import write_files
from studies.demo.embedded import embedded_cell, embedded_plan
from studies.plots.style import Picture, folder_files
from studies.research.paper.figure_arm import figure_2
from studies.research.paper.figure_setup import figure_3
from studies.research.paper.figure_tool import figure_1, figure_4


def pictures() -> list[Picture]:
    """All four, from the embedded cell."""
    cell = embedded_cell()
    plan = embedded_plan(cell)
    return [figure_1(cell), figure_2(), figure_3(cell, plan), figure_4(cell)]


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Draw the counterparts of the paper's Figures 1 to 4 into FOLDER: SVG, PNG and CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    made = folder_files(pictures(), folder)
    write_files(made)
    for path in made:
        click.echo(f"wrote {path}")


if __name__ == "__main__":
    main()
