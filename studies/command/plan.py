"""``posecal diagnose --plan-only``: what a plan can show, before anything is measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import faults_in

if TYPE_CHECKING:
    from calib import Cell


def foresee_plan(cell: Cell, plan_path: Path, json_path: str | None, seed: int) -> None:
    """State what a plan, or the readings of a table without their points, could show."""
    import calib
    from calib.files.tables import holds_points
    from doe.forecast.foresee import foresee
    from studies.results.base import envelope
    from studies.results.plan import PlanResult

    inputs = [cell.path, *cell.robot_files, plan_path]
    check_outputs([output_file(json_path)], inputs)
    load = calib.load_measurements if holds_points(plan_path) else calib.load_plan
    plan = load(cell, plan_path)
    with faults_in(plan_path, effects_of=cell.path), working("looking ahead"):
        found = foresee(cell, plan)
    deliver(PlanResult.of(found, cell, envelope(cell.name, inputs, seed)), json_path)
