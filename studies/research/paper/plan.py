"""Table II's fifteen poses beside optimal ones.

    python -m studies.research.paper.plan [--candidates N]

The paper says how its poses were restricted (five angles of A2, joint limits, obstacles that it does
not list) and not how they were chosen. Here are plans of the same size at the same levels within the
same joint limits, on the same model: 250 kg at (300, 0, 150) mm, which makes chi_6 observable, three
markers, base and tool known, nine compliances; targets of a milling task.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

import doe
from calib import Cell, Poses, load_targets
from calib.cell.planned import Planned, Targets
from doe.curve import poses_that_match
from studies.command.deliver import console_for
from studies.demo.embedded import embedded_cell, embedded_plan
from studies.document.terminal import plain_table

EFFECTS = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
LEVELS = "A2=-140,-99.85,-56.9,-25.24,-0.01x3"
TARGETS_DEG = ((0, -90, 90, 0, 45, 0), (30, -70, 100, 20, 60, 30), (-30, -50, 80, -30, -45, 10))


@dataclass(frozen=True)
class Case:
    """A criterion and where its error counts; ``key`` is the figure of the assessment to compare."""

    name: str
    criterion: str
    at_markers: bool
    key: str


CASES = (
    Case("task (markers)", "task", True, "task_rms"),
    Case("task (tip)", "task", False, "task_rms"),
    Case("A", "A", True, "trace"),
    Case("D", "D", True, "determinant"),
)


def cell_of_the_paper(folder: Path, link_weights: bool) -> Cell:
    """The embedded cell with the elastostatic model and the milling targets."""
    rows = [",".join(f"A{k}_deg" for k in range(1, 7))]
    rows += [",".join(map(str, row)) for row in TARGETS_DEG]
    path = folder / "targets.csv"
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    cell = embedded_cell()
    robot = cell.robot if link_weights else replace(cell.robot, masses=np.zeros(cell.robot.dof))
    cell = replace(cell, effects=EFFECTS, robot=robot)
    targets = Targets(path, *load_targets(cell, path))
    return replace(cell, design=Planned(targets=targets))


def compared(cell: Cell, table_two: Poses, case: Case, candidates: int) -> dict[str, Any]:
    """An optimal plan beside Table II: both figures, their ratio, the proof, and poses that match."""
    plan = doe.design(
        cell,
        levels=LEVELS,
        criterion=case.criterion,
        candidates=candidates,
        at_markers=case.at_markers,
        against={"Table II": table_two},
        curve=True,
    )
    rival = plan.rivals["Table II"].assessment
    own, theirs = getattr(plan.assessment, case.key), getattr(rival, case.key)
    return {
        "case": case.name,
        "optimal": own,
        "table_two": theirs,
        "ratio": max(own / theirs, theirs / own),
        "efficiency": plan.efficiency,
        "table_two_efficiency": plan.rivals["Table II"].efficiency,
        "poses_that_match": poses_that_match(plan.curve, plan)["Table II"],
        "seconds": sum(plan.seconds.values()),
    }


@click.command()
@click.option("--candidates", default=100_000, show_default=True)
def main(candidates: int) -> None:
    """Print the comparison, without and with the weight of the links."""
    console = console_for(None)
    with tempfile.TemporaryDirectory() as folder:
        for link_weights in (False, True):
            table = plain_table(
                ("\ncriterion", "left"),
                ("\noptimal", "right"),
                ("\nTable II", "right"),
                ("\nratio", "right"),
                ("\nproved", "right"),
                ("share of\nTable II", "right"),
                ("poses that\nmatch it", "right"),
                ("\ntime [s]", "right"),
            )
            cell = cell_of_the_paper(Path(folder), link_weights)
            for case in CASES:
                row = compared(cell, embedded_plan(cell), case, candidates)
                table.add_row(
                    row["case"],
                    f"{row['optimal']:.4g}",
                    f"{row['table_two']:.4g}",
                    f"{row['ratio']:.2f}",
                    f"{row['efficiency']:.4f}",
                    f"{row['table_two_efficiency']:.3f}",
                    str(row["poses_that_match"]),
                    f"{row['seconds']:.1f}",
                )
            weights = "with the weights of the links" if link_weights else "massless arm"
            console.print(f"\n{weights}, {candidates} candidates; task in m, A and D in urad/(N m)")
            console.print(table)


if __name__ == "__main__":
    main()
