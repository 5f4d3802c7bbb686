"""``posecal design --motions``: which motions to log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.command import options
from studies.command.call import Call, working

if TYPE_CHECKING:
    from calib import Cell


def deliver_planned_motions(
    call: Call, cell: Cell, plan_path: Path | None, asked: dict[str, Any], refused: dict[str, Any]
) -> None:
    """Choose motions, and deliver.

    asked : of ``doe.design_motions``; refused : options that go with poses alone, by name

    Raises InputError.
    """
    from calib.errors import InputError
    from calib.files.write_tables import commanded_csv
    from doe import design_motions
    from studies.results.design_motions import MotionDesignResult, name_of

    for name, given in refused.items():
        if given:
            raise InputError(name, "", "does not go with --motions", "leave it out")
    if isinstance(asked.get("candidates"), Path):
        raise InputError("--candidates", "", "is no number", "motions are drawn; give how many")
    inputs = [cell.path, *cell.robot_files]
    call.check(inputs, plan_path)
    with options.faults_in(cell.path), working("choosing motions"):
        found = design_motions(cell, seed=call.seed, **asked)
    runs = [(name_of(k), own.time, own.at(own.time)[0], own.payload.mass)
            for k, own in enumerate(found.motions)]  # fmt: skip
    text = commanded_csv(cell, runs)
    result = MotionDesignResult.of(found, call.envelope(cell, inputs))
    call.deliver(result, {} if plan_path is None else {plan_path: text})
