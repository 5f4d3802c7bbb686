"""``posecal identify``: parameters of the model from measured points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command import options
from studies.command.call import Call, working
from studies.command.motion import Form, deliver_motions, mjcf
from studies.command.session import read_session

if TYPE_CHECKING:
    from calib.identification.fit import Method
    from calib.observations import Approach, Weighting

_MOST = 200_000  # readings of a table that are identified: they take 15 kB each
_SECONDS = 0.8e-3  # a reading, as studies.research.speed measures


# fmt: off
@click.command()
@options.cell
@options.data
@options.holdout
@options.choice("--approach", ("points", "pose"),
                "Use marker points, or full poses computed from them.")
@options.choice("--method", ("joint", "two-step"),
                "All parameters together, or base and tool in turn.")
@options.choice("--weighting", ("full", "normalised", "plain"), "Of full poses: by their covariance, "
                "by one standard deviation for each component, or by one length for the rotations.")
@options.value("--length-mm", "MM", "Length that converts rotations to mm in the plain weighting.",
               options.Finite(min=1e-3, max=1e6), default=1000.0, show_default=True)
@options.value("--urdf urdf_path", "OUT",
               "Write the robot with the identified geometry and the markers, "
               "or of motions with links and friction.")
@mjcf
@options.value("--zero-offsets zeros_path", "OUT",
               "Write joint offsets alone, for a plain controller.")
@options.result()
def identify(
    call: Call, cell_path: Path, data_path: Path, holdout: str | None, approach: Approach,
    method: Method, weighting: Weighting, length_mm: float, urdf_path: Path | None,
    zeros_path: Path | None, mjcf_path: Path | None,
) -> None:
    """Identify the effects in the cell's [model] from measured points.

    CELL describes the measurement cell (cell.toml). DATA is the table of measured points
    (measurements.csv), one row for each point; or of motions, joint angles and torques over time.

    \b
    Example:
      posecal identify cell.toml measurements.csv --holdout 0.3 --json result.json
    """
    import calib
    from calib.errors import InputError
    from calib.files.motions import holds_motions
    from calib.poses.moves import thinned
    from studies.command.robots import robot_files
    from studies.results.identify import IdentifyResult

    cell = calib.load_cell(cell_path)
    if holds_motions(data_path):
        outputs: dict[Form, Path | None] = {"urdf": urdf_path, "mjcf": mjcf_path}
        refused = {"--zero-offsets": zeros_path}
        deliver_motions(call, cell, data_path, holdout, "identify", outputs, **refused)
        return
    if mjcf_path is not None:
        raise InputError("--mjcf", "", "goes with motions", "use --urdf for points")
    with working(f"reading {data_path.name}"):
        day = read_session(cell, data_path, holdout, call.seed)
    inputs = [cell.path, *cell.robot_files, data_path, *cell.named_files, *day.files]
    call.check(inputs, urdf_path, zeros_path)
    data, shortened = thinned(day.data, _MOST)
    with (
        working(f"identifying {len(data)} readings", _SECONDS * len(data)),
        options.faults_in(data_path, effects_of=cell.path),
    ):
        found = calib.identify(
            cell, data, heldout=day.heldout, approach=approach, method=method,
            weighting=weighting, length=length_mm * 1e-3
        )
    of_pose = approach == "pose"
    result = IdentifyResult.of(
        found, cell, call.envelope(cell, inputs),
        whole=day.whole,
        holdout=holdout,
        weighting=weighting if of_pose else None,
        length_mm=length_mm if of_pose and weighting == "plain" else None,
        warnings=(*day.warnings, *shortened),
    )
    files, notes = robot_files(cell, found, urdf_path, zeros_path)
    call.deliver(result, files, notes=notes)
