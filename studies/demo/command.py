"""``posecal demo``: the whole way on the paper's robot, from an embedded cell."""

from __future__ import annotations

import functools
from pathlib import Path

import click

from studies.command.deliver import deliver
from studies.command.options import result_options


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("posecal-demo"))
@result_options(figures=False)
def demo(folder: Path, json_path: str | None, seed: int) -> None:
    """Run the whole way in FOLDER: plan, measure, identify, compare, diagnose, report.

    The robot is the paper's KR 270. It is measured by simulation, free and with 250 kg on the tool. It
    has an error that its model lacks; another --seed selects another error. All inputs and results are
    files. Edit them and run the commands again.

    \b
    Example:
      posecal demo my-first-calibration
    """
    from calib.files.write import make_folder
    from studies.demo.way import Demonstration

    make_folder(folder)
    say = functools.partial(click.echo, err=json_path == "-")
    deliver(Demonstration(folder, seed, say).go(), json_path)
