"""Motions that a controller logged: runs of joint angles and torques, or currents, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.errors import CalibError

Unit: TypeAlias = Literal["Nm", "A"]
"""Of what drives the joints: torque (N where a joint slides), or the motors' current."""


@dataclass(frozen=True, eq=False)
class Run:
    """One motion, logged without a break.

    time : ndarray, shape (m,), s, increasing
    q : ndarray, shape (m, n), rad or m, joint values, measured at the motors
    effort : ndarray, shape (m, n), N m, N or A
    link : ndarray, shape (m, n), rad or m, measured behind the gears; NaN where not; or None
    """

    name: str
    time: Array
    q: Array
    effort: Array
    link: Array | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def step(self) -> float:
        """Usual time between two rows, s."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True, eq=False)
class Motions:
    """Runs of one robot.

    unit : of all efforts; warnings : what the reader of the table noticed
    """

    runs: tuple[Run, ...]
    unit: Unit = "Nm"
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return sum(map(len, self.runs))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the runs."""
        return tuple(run.name for run in self.runs)

    def take(self, names: Sequence[str]) -> Motions:
        """The runs of these names. Raises CalibError for one that is not there."""
        if unknown := [name for name in names if name not in self.names]:
            raise CalibError(f"no session {unknown[0]!r}; there are {', '.join(self.names)}")
        chosen = tuple(run for run in self.runs if run.name in names)
        return Motions(chosen, self.unit, self.warnings)

    def earlier(self, late: float) -> Motions:
        """With efforts that were stamped so many seconds late."""
        from scipy.interpolate import CubicSpline

        runs = (
            replace(run, effort=CubicSpline(run.time - late, run.effort)(run.time))
            for run in self.runs
        )
        return replace(self, runs=tuple(runs))

    def split(self, share: float, rng: np.random.Generator | int = 0) -> tuple[Motions, Motions]:
        """Runs to fit, and about this share of them, at least one, to hold out.

        Raises CalibError for fewer than two runs.
        """
        if len(self.runs) < 2:
            raise CalibError("one run cannot be split; hold out a run of a second session")
        held = min(max(1, round(share * len(self.runs))), len(self.runs) - 1)
        drawn = np.random.default_rng(rng).permutation(len(self.runs))[:held].tolist()
        names = [self.names[i] for i in drawn]
        kept = [name for name in self.names if name not in names]
        return self.take(kept), self.take(names)
