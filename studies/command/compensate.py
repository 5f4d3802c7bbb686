"""``posecal compensate``: joint commands that bring the real arm to nominal targets."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command import options
from studies.command.call import Call, working


# fmt: off
@click.command()
@options.cell
@click.argument("result_path", metavar="RESULT", type=options.PATH)
@click.argument("targets_path", metavar="TARGETS", type=options.PATH)
@options.value("-o --output plan_path", "FILE", "Write the targets with corrected joints as a plan.")
@options.value("--tip", "LINK", "Of several tips the one that is to be in place.", str)
@options.result(figures=False, seed=False)
def compensate(
    call: Call, cell_path: Path, result_path: Path, targets_path: Path, plan_path: Path | None,
    tip: str | None,
) -> None:
    """Correct joint commands, so that the real arm goes where the nominal arm should be.

    RESULT is the JSON of identify or diagnose. TARGETS is a table of nominal joint commands. A
    target may have a wrench; otherwise the cell's [load] acts. Geometry, load and all other
    identified effects are corrected together. The expected remaining error is stated.

    \b
    Example:
      posecal identify cell.toml measurements.csv --json result.json
      posecal compensate cell.toml result.json targets.csv -o corrected.csv
    """
    import calib
    from calib.errors import InputError
    from calib.files.estimate import load_estimate
    from calib.files.write_tables import compensated_csv, nominal_table
    from studies.results.compensate import CompensateResult

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, result_path, targets_path]
    call.check(inputs, plan_path)
    table = nominal_table(cell, targets_path)
    estimate = load_estimate(cell, result_path)
    if not estimate.converged:
        raise InputError(result_path, "", "did not converge", "mend the identification first")
    targets, weights = calib.load_targets(cell, targets_path)
    with options.faults_in(targets_path), working("correcting the targets"):
        found = calib.compensate(cell, estimate, targets, weights=weights, tip=tip)
    call.deliver(
        CompensateResult.of(found, cell, call.envelope(cell, inputs)),
        {} if plan_path is None else {plan_path: compensated_csv(cell, table, found)},
    )
