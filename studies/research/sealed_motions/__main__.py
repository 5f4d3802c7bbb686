"""Sealed motions: an independent truth of torques, and how often the diagnosis names what is there.

    python -m studies.research.sealed_motions [--cases 60] [--seed 0] [--workers 2] [--json FILE]

Each case is written as its user would log it, ``posecal diagnose`` answers from the files alone, and
its answer is held against the key, which never leaves this process.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from studies.research.bench import Output, bench, count, each, table
from studies.research.sealed_motions.arms import urdf
from studies.research.sealed_motions.score import Score, rates, scored
from studies.research.sealed_motions.truth import Case, case

_CELL = """schema = 1
[robot]
urdf = "robot.urdf"
base = "base"
tip = "{tip}_link"
[robot.gear_ratio]
{ratios}
[motion]
cutoff_hz = 10
[model]
effects = {effects}
"""


def answered(number: int, *, seed: int) -> Score:
    """The score of one case."""
    own = case(number, seed)
    with TemporaryDirectory() as place:
        folder = Path(place)
        written(own, folder)
        asked = ["cell.toml", "motion.csv", "--holdout", "heldout.csv", "--json", "answer.json"]
        subprocess.run(  # noqa: S603
            [sys.executable, "-c", "from studies.cli import run; run()", "diagnose", *asked],
            cwd=folder, check=True, capture_output=True, timeout=600,
        )  # fmt: skip
        return scored(own, json.loads((folder / "answer.json").read_text(encoding="utf-8")))


def written(own: Case, folder: Path) -> None:
    """Write what the user of the robot has: cell, robot file, and the runs."""
    joints = own.arm.joints
    ratios = "\n".join(f"{joint} = {own.arm.ratio}" for joint in joints)
    cell = _CELL.format(tip=joints[-1], ratios=ratios, effects=json.dumps(own.effects))
    (folder / "cell.toml").write_text(cell, encoding="utf-8")
    (folder / "robot.urdf").write_text(urdf(own.arm), encoding="utf-8")
    fitted = [name for name in own.runs if name not in own.held]
    for file, names in (("motion.csv", fitted), ("heldout.csv", own.held)):
        with (folder / file).open("w", encoding="utf-8", newline="") as out:
            rows = csv.writer(out)
            rows.writerow(["session", "time_s", *(f"{j}_rad" for j in joints),
                           *(f"{j}_Nm" for j in joints)])  # fmt: skip
            for name in names:
                time, q, torque = own.runs[name]
                for row in np.column_stack([time, q, torque]).tolist():
                    rows.writerow([name, *(f"{x:.9g}" for x in row)])


@bench(count("--cases", 60), workers=True)
def main(cases: int, workers: int, seed: int) -> Output:
    """Draw cases, let the diagnosis answer, and score."""
    scores = each(answered, [(k,) for k in range(cases)], workers, seed=seed)
    rows = [asdict(own) for own in scores]
    shown = [
        {key: _names(own) if key in ("wrong", "missed") else own for key, own in row.items()
         if key != "held"}
        for row in rows
    ]  # fmt: skip
    found = rates(scores)
    figures = {"figures": [rate.as_dict() for rate in found], "cases": rows}
    return [table(shown), table(rate.row() for rate in found)], figures


def _names(names: Iterable[tuple[str, str]]) -> str:
    return ", ".join(map(":".join, names))


if __name__ == "__main__":
    main()
