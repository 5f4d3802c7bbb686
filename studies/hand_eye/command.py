"""``posecal hand-eye``: where a camera sits, how good that is, and what limits it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
)
from studies.command.session import read_session

if TYPE_CHECKING:
    from calib.handeye.samples import Eye


@click.command("hand-eye")
@cell_argument
@data_argument
@click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Held-out poses: a table, or a share of the configurations. Default: each fifth of the poses "
    "is predicted from the others.",
)
@click.option(
    "--eye",
    type=click.Choice(["in-hand", "on-base"]),
    default=None,
    help="Where the camera is, for instruments that read poses. Default: in-hand.",
)
@click.option("--goal-mm", metavar="X", type=Finite(min=0, min_open=True),
              help="Goal: expected RMS error at the targets.")  # fmt: skip
@click.option("-o", "plan_path", metavar="PLAN", type=PATH, help="Write the next poses as a plan.")
@result_options()
def hand_eye(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    eye: Eye | None,
    goal_mm: float | None,
    plan_path: Path | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Say where the camera sits, how good that is, and whether the arm limits it.

    CELL has a camera and a board, or an instrument that reads poses of a body. DATA is the table of
    its readings. The command compares the hand-eye with the arm as its file has it, with the arm
    calibrated, and by OpenCV's five methods (easy_handeye, MoveIt), all at the same held-out poses.

    \b
    Example:
      posecal hand-eye cell.toml measurements.csv --goal-mm 0.5 -o next.csv
    """
    import calib
    from studies.hand_eye.record import hand_eye_record, next_poses
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    session = read_session(cell, data_path, holdout, seed)
    data, heldout, files, warnings = session.held
    inputs = [*session.read, *session.named, *files]
    check_outputs([plan_path, output_file(json_path)], inputs, folder)
    with faults_in(cell_path, readings_of=data_path), working("calibrating hand and eye"):
        found = calib.hand_eye(cell, data, heldout=heldout, eye=eye, seed=seed)
    goal = None if goal_mm is None else goal_mm * 1e-3
    with working("looking for the next poses"):
        ahead = next_poses(found, data, heldout, goal, seed)
    made_from = envelope(cell.name, inputs, seed, cell.about)
    record = hand_eye_record(found, ahead, goal, made_from, warnings)
    plans = {} if plan_path is None else ahead.table(plan_path, found.cell)
    deliver(record, json_path, folder, plans)
