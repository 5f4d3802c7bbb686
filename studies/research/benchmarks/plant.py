"""A plant of simulated robots: types that share a model and a fault, robots with errors of their own.

The arms stand in MuJoCo (:mod:`studies.research.benchmarks.day`); the user's files know none of it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.arrays import Array
from studies.research.benchmarks.day import ARMS, Setting, draw_day, write_day

FAULTY = 20
"""One robot in so many has a table that cannot be read."""
KNOCKED = 25
"""The second joint of one robot in so many is off by far more than those of its type."""
_KNOCK = 8e-3  # rad or m: a tooth of a belt
_SIZE = 2e-4  # rad or m, of the type's fault
_SPREAD = 0.1  # by which its size differs from robot to robot


def write_plant(folder: Path, robots: int, *, seed: int = 0, poses: int = 24) -> None:
    """Folders ``TYPE/0001`` .. with cell, robot, targets and table; types in turn."""
    for index in range(robots):
        place = folder / list(ARMS)[index % len(ARMS)] / f"{index:05d}"
        place.mkdir(parents=True)
        write_robot(place, index, seed=seed, poses=poses)
        if index % FAULTY == FAULTY - 1:
            _spoil(place / "measurements.csv")


def write_robot(place: Path, index: int, *, seed: int, poses: int) -> None:
    """One robot; all err as the sine of their second joint, by about the same."""
    setting = Setting(list(ARMS)[index % len(ARMS)], 10e-6, 1, poses, 3)
    size = _SIZE * (1.0 + _SPREAD * np.random.default_rng([seed, index]).normal())
    knock = _KNOCK * knocked(index)
    write_day(place, draw_day(setting, index, seed, _second_joint(float(size), knock)))
    (place / "exact.csv").unlink()  # what a perfect day had read


def knocked(index: int) -> bool:
    """Whether a robot was."""
    return index % KNOCKED == KNOCKED // 3 - 1


def _second_joint(size: float, knock: float) -> Callable[[Array], Array]:
    def truth(q: Array) -> Array:
        moved = q.copy()
        moved[:, 1] += knock + size * np.sin(q[:, 1])
        return moved

    return truth


def _spoil(table: Path) -> None:
    """A reading that is no number, as a tracker writes where its beam was broken."""
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    rows[3][-1] = "beam broken"
    with table.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)
