"""A plan: the poses, how good they are, and the proof of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array
from calib.poses import Poses, poses_at
from calib.result import Result
from doe.assess import Assessment
from doe.levels import AngleLevels
from doe.order import PlannedDay, Reapproaches
from doe.problem import Problem

_PAYS = 0.05  # squared error times poses, above its least, that is still as good


@dataclass(frozen=True, eq=False)
class Candidates:
    """What the plan was chosen from.

    drawn, feasible : int; removed_by : dict, constraint -> count, each where it fell first
    """

    drawn: int
    feasible: int
    removed_by: dict[str, int]


@dataclass(frozen=True, eq=False)
class Certificate:
    """The proof, as information functions: the larger the better. Second visits count.

    value : float, criterion of the plan
    bound : float, no plan of the candidates and of the plan's own poses is better, with as many
        second visits or with other poses in their place
    weighted : float, criterion of the best weighted plan, at which the bound was found
    agreement_of_starts : float, median over the starts of the search of what they ended at, over the
        best plan of candidates: near one, what is missing to the bound is likely the bound's slack
    """

    value: float
    bound: float
    weighted: float
    agreement_of_starts: float

    @property
    def efficiency(self) -> float:
        """At least this fraction of the best that any allowed plan could reach."""
        return min(1.0, self.value / self.bound)

    @property
    def solver_gap(self) -> float:
        """Part of the missing efficiency that the relaxation's own gap accounts for."""
        return max(0.0, self.bound / self.weighted - 1.0)


@dataclass(frozen=True)
class CurveStep:
    """The best plan found of so many poses.

    poses : int; value : float, criterion as shown; task_rms : float, m; efficiency : float
    """

    poses: int
    value: float
    task_rms: float
    efficiency: float


@dataclass(frozen=True, eq=False)
class Rival:
    """A plan of so many poses that was judged beside the result, against the same bound."""

    poses: int
    assessment: Assessment
    efficiency: float


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """The result of :func:`doe.design`.

    problem : Problem
    poses : Poses, in the order of measuring, second visits included
    levels : AngleLevels, settled, or None
    assessment : Assessment; certificate : Certificate; candidates : Candidates
    rivals : dict, name -> Rival
    curve : tuple of CurveStep, plans of fewer and more poses, empty unless asked for
    notes : tuple of str, what a reader should know
    granted : tuple of str, what the expected error takes for granted
    seconds : float, that it took
    reapproaches : Reapproaches or None
    day : PlannedDay, the order of the poses and the time that it takes
    """

    problem: Problem
    poses: Poses
    levels: AngleLevels | None
    assessment: Assessment
    certificate: Certificate
    candidates: Candidates
    day: PlannedDay
    rivals: dict[str, Rival] = field(default_factory=dict)
    curve: tuple[CurveStep, ...] = ()
    notes: tuple[str, ...] = ()
    granted: tuple[str, ...] = ()
    seconds: float = 0.0
    reapproaches: Reapproaches | None = None

    def sentences(self) -> list[str]:
        return [
            f"Design: {len(self.poses)} poses, criterion {self.criterion} {self.value:.4g}",
            f"at least {self.efficiency:.1%} of the best that any plan of these candidates reaches",
            *self.notes,
        ]

    def rows(self) -> list[dict[str, object]]:
        robot = self.problem.cell.robot
        return [
            {"pose": name, **robot.shown(q)}
            for name, q in zip(self.poses.names, self.poses.q, strict=True)
        ]

    @property
    def level(self) -> Array:
        """Level at which each pose stands, rad or m, NaN without levels, shape (N,)."""
        q, levels = self.poses.q, self.levels
        return np.full(len(q), np.nan) if levels is None else q[:, levels.joint]

    @property
    def criterion(self) -> str:
        """Name of the criterion."""
        return self.problem.criterion.name

    @property
    def value(self) -> float:
        """The criterion as it is shown."""
        return self.problem.criterion.shown(self.certificate.value)

    @property
    def bound(self) -> float:
        """What no allowed plan surpasses, as the criterion is shown."""
        return self.problem.criterion.shown(self.certificate.bound)

    @property
    def efficiency(self) -> float:
        """At least this fraction of the best that any allowed plan could reach."""
        return self.certificate.efficiency


def named(q: Array) -> Poses:
    """Poses p01, p02 .. at joint values (N, dof)."""
    width = max(2, len(str(len(q))))
    return poses_at(q, names=tuple(f"p{i + 1:0{width}d}" for i in range(len(q))))


def stops_paying(counts: Sequence[int], errors: Sequence[float]) -> int | None:
    """The count of poses or readings from which on more of them only average noise; None for none.

    counts, errors : as many of each, expected RMS error in any unit
    Then the squared error falls as one over their number: twice the poses for a third off the error.
    With fewer, every further pose does more than that.
    """
    if not counts:
        return None
    work = np.array(counts) * np.array(errors) ** 2
    return counts[int(np.flatnonzero(work <= (1.0 + _PAYS) * work.min())[0])]
