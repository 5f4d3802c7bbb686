"""FIGAROH's regularised estimators on the same tables, in an environment of their own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calib.arrays import Array
from calib.files.write import json_text
from studies.research.benchmarks.few_poses.truth import SIGMA, Day
from studies.research.benchmarks.peers.judge import Left, environment, solved
from studies.research.benchmarks.peers.work import Work
from studies.research.withheld.texts import urdf

WAYS = {"map": "FIGAROH map", "map_cv": "FIGAROH map_cv"}


def interpreter(folder: Path) -> Path | Left:
    """Of an environment that has FIGAROH, made below a folder if it does not stand."""
    return environment(folder, "figaroh")


def solved_by_figaroh(python: Path, day: Day, poses: int) -> Mapping[str, Array | str]:
    """Predicted points at the held-out poses (200, M, 3), m, or why there are none, by way."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        read = day.read[:poses]
        joints = list(day.arm.names)
        numbered = [f"{axis}{k + 1}" for k in range(len(day.markers)) for axis in "xyz"]
        rows = np.column_stack([day.q[:poses], read.reshape(poses, -1)])
        work = {
            "name": day.arm.name, "tip": day.arm.tip, "base": day.arm.base, "joints": joints,
            "markers": {f"m{k + 1}": m.tolist() for k, m in enumerate(day.guesses)},
            "sigma": SIGMA, "ways": list(WAYS),
        }  # fmt: skip
        (folder / "work.json").write_text(json_text(work), encoding="utf-8")
        (folder / "robot.urdf").write_text(urdf(day.arm, masses=False), encoding="utf-8")
        _table(folder / "fit.csv", [*joints, *numbered], rows)
        _table(folder / "heldout.csv", joints, day.held)
        answer = solved(python, "figaroh_map", Work(folder, read, day.points(day.held)), 1)
    if isinstance(answer, Left):
        return dict.fromkeys(WAYS.values(), answer.why)
    found: dict[str, Array | str] = {}
    for run in answer["runs"]:
        found[WAYS[run["way"]]] = run["failed"] or np.array(run["heldout"])
    return found


def _table(path: Path, head: list[str], rows: Array) -> None:
    np.savetxt(path, rows, "%.12g", ",", header=",".join(head), comments="")
