"""``posecal changes``: what moved between two results of one robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command import options
from studies.command.call import Call, working

if TYPE_CHECKING:
    from calib import Cell
    from calib.change import DayEstimate
    from studies.results.identify import IdentifyResult


# fmt: off
@click.command()
@click.argument("before_path", metavar="BEFORE", type=options.PATH)
@click.argument("after_path", metavar="AFTER", type=options.PATH)
@options.value("--cell cell_path", "CELL", "The cell of AFTER. Default: the cell that AFTER names.")
@options.value("--tolerance-mm", "X", "Largest allowed error at any target.", options.ABOVE_ZERO)
@options.result(figures=False, seed=False)
def changes(
    call: Call, before_path: Path, after_path: Path, cell_path: Path | None,
    tolerance_mm: float | None,
) -> None:
    """Say what moved on a robot between two results, and whether the first still holds.

    BEFORE and AFTER are JSON results of identify with the same [model] effects.

    \b
    Example:
      posecal identify cell.toml may.csv --json may.json
      posecal identify cell.toml june.csv --json june.json
      posecal changes may.json june.json --tolerance-mm 0.2
    """
    from calib import change
    from calib.files.estimate import load_estimate
    from studies.results.changes import ChangesResult
    from studies.results.identify import IdentifyResult
    from studies.results.read import read_as

    paths = (before_path, after_path)
    days = {path: read_as(path, IdentifyResult) for path in paths}
    cell = _cell(days, cell_path)
    inputs = [cell.path, *cell.robot_files, *paths]
    call.check(inputs)
    estimate = load_estimate(cell, after_path)
    with options.faults_in(after_path), working("comparing the days"):
        before, after = (_day(days[path]) for path in paths)
        found = change.changes(cell, before, after, estimate)
    names, made_from = (before_path.name, after_path.name), call.envelope(cell, inputs)
    call.deliver(ChangesResult.of(found, estimate, names, tolerance_mm, made_from))


# fmt: on
def _cell(days: dict[Path, IdentifyResult], path: Path | None) -> Cell:
    """The cell of the later result, whose robot must be that of both. Raises InputError."""
    from calib import load_cell
    from calib.errors import InputError
    from calib.files.read import sha256
    from studies.results.read import located

    after = [*days][-1]
    source = located(after, days[after].inputs[0].file, days[after].inputs[0].sha256)
    path = path or source.path
    if path is None:
        what = f"its cell {source.file} is {source.state}"
        raise InputError(after, "inputs", what, "give it with --cell")
    cell = load_cell(path)
    for file, day in days.items():
        if not day.estimate.converged:
            raise InputError(file, "", "did not converge", "mend the identification first")
        for of_robot in cell.robot_files:
            if sha256(of_robot) not in {entry.sha256 for entry in day.inputs}:
                what = f"was not made with the {cell.robot.source} {of_robot} as it stands"
                remedy = "compare results of one robot, identified from one nominal model"
                raise InputError(file, "inputs", what, remedy)
    return cell


def _day(result: IdentifyResult) -> DayEstimate:
    """What a result states of a robot, in SI."""
    import numpy as np

    from calib.change import COORDINATES, DayEstimate
    from calib.inference.coverage import freedom

    estimate, scatter = result.estimate, result.estimate.scatter_SI
    scatters = scatter is not None and any((*scatter.approach, *scatter.configuration))
    noise = np.inf if result.noise.source == "cell" else result.noise.degrees_of_freedom
    noise = result.degrees_of_freedom if noise is None else noise
    keys = tuple((p.effect, p.where, p.name) for p in estimate.parameters)
    return DayEstimate(
        keys,
        np.array([p.value_SI for p in estimate.parameters]),
        np.array(estimate.covariance_SI),
        np.array([f"{effect}:{where}.{n}" in estimate.undetermined for effect, where, n in keys]),
        {name: np.array(at) * 1e-3 for name, at in result.markers_mm.items()},
        freedom(noise, result.poses, len(keys), as_a_whole=scatters, numbers=COORDINATES),
    )
