"""A plan: the poses, how good they are, and the proof of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.poses import Poses, poses_at
from calib.se3 import Array
from doe.assess import Assessment
from doe.constraints.self_collision import SelfCollision
from doe.levels import Levels
from doe.problem import Problem


@dataclass(frozen=True, eq=False)
class Candidates:
    """What the plan was chosen from.

    drawn, feasible : int; removed_by : dict, constraint -> count, each where it fell first
    survivors : int, candidates that a better plan could still contain
    """

    drawn: int
    feasible: int
    removed_by: dict[str, int]
    survivors: int


@dataclass(frozen=True, eq=False)
class Certificate:
    """The proof, as information functions: the larger the better.

    value : float, criterion of the plan
    bound : float, no plan of the candidates and of the plan's own poses is better
    weighted : float, criterion of the best weighted plan, at which the bound was found
    fresh : float, bound over as many fresh candidates, NaN where none were drawn
    pool_value : float, criterion of the best plan of candidates alone, before its angles were polished
    pool_bound : float, bound for it
    optimal : bool, branch and bound proved that plan the best of the candidates; nodes : int
    rounds : int, column generation
    agreement : float, median over the starts of the search of what they ended at, over the best plan
        of candidates: near one, what is missing to the bound is likely the bound's slack
    left : float, criterion after the loss of the pose that the plan can least spare
    """

    value: float
    bound: float
    weighted: float
    fresh: float
    pool_value: float
    pool_bound: float
    optimal: bool
    nodes: int
    rounds: int
    agreement: float
    left: float

    @property
    def efficiency(self) -> float:
        """At least this fraction of the best that any allowed plan could reach."""
        return min(1.0, self.value / self.bound)

    @property
    def solver_share(self) -> float:
        """Part of the missing efficiency that the relaxation's own gap accounts for."""
        return max(0.0, self.bound / self.weighted - 1.0)


@dataclass(frozen=True)
class Step:
    """The best plan found of so many poses.

    poses : int; value : float, criterion as shown; task_rms : float, m; efficiency : float
    """

    poses: int
    value: float
    task_rms: float
    efficiency: float


@dataclass(frozen=True, eq=False)
class Rival:
    """A plan that was judged beside the result: efficiency against the same bound."""

    assessment: Assessment
    efficiency: float
    poses: int


@dataclass(frozen=True, eq=False)
class Design:
    """The result of :func:`doe.design`.

    problem : Problem
    poses : Poses, in the order of measuring
    level : ndarray, shape (N,), rad or m, NaN without levels; levels : Levels, settled, or None
    assessment : Assessment; certificate : Certificate; candidates : Candidates
    travel : float, rad or m, joint travel from the first pose to the last
    rivals : dict, name -> Rival
    curve : tuple of Step, plans of fewer and more poses, empty unless asked for
    notes : tuple of str, what a reader should know
    seconds : dict, part -> time
    """

    problem: Problem
    poses: Poses
    level: Array
    levels: Levels | None
    assessment: Assessment
    certificate: Certificate
    candidates: Candidates
    travel: float
    rivals: dict[str, Rival] = field(default_factory=dict)
    curve: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

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
    return poses_at(q, names=[f"p{i + 1:0{width}d}" for i in range(len(q))])


def level_values(levels: Levels | None, q: Array) -> Array:
    """Level at which each pose stands, rad or m, NaN without levels."""
    return np.full(len(q), np.nan) if levels is None else q[:, levels.joint]


def notes_of(design: Design) -> tuple[str, ...]:
    """What a reader should know about a plan."""
    return tuple(note for rule in _NOTES for note in rule(design))


def _weak(design: Design) -> Iterator[str]:
    sizes = design.problem.model.sizes
    weak = ~(design.assessment.std <= sizes)
    if weak.any():
        ids = [p.id for p, w in zip(design.problem.model.parameters, weak, strict=True) if w]
        yield (
            f"{', '.join(ids[:6])}{' ..' if len(ids) > 6 else ''}: more uncertain than such errors are "
            f"large; criterion {design.criterion} does not need them better, A or D would"
        )


def _unmoved(design: Design) -> Iterator[str]:
    """E can be bounded by a direction that is the same at every pose."""
    if design.criterion == "E" and design.efficiency > 0.999999:
        yield (
            "E is set by a direction that no choice of poses changes, as a shift of the base does; "
            "name the parameters that matter with --of"
        )


def _no_targets(design: Design) -> Iterator[str]:
    if design.problem.cell.design.get("targets") is None:
        count = len(design.problem.targets)
        yield f"no target poses given: {count} Sobol poses within the limits stand for them"


def _unguarded(design: Design) -> Iterator[str]:
    cell = design.problem.cell
    if cell.design.get("obstacle") and not set(cell.capsules) - {"base"}:
        yield "obstacles are given but no [robot.capsules_mm]: nothing keeps the arm away from them"


def _exempt(design: Design) -> Iterator[str]:
    for constraint in design.problem.constraints:
        if isinstance(constraint, SelfCollision) and constraint.exempt:
            pairs = ", ".join(f"{a} with {b}" for a, b in constraint.exempt)
            yield f"capsules that touch at every pose are not checked against each other: {pairs}"


def _hidden(design: Design) -> Iterator[str]:
    hidden = design.assessment.hidden
    if hidden:
        total = len(design.poses) * len(design.problem.model.marker_names)
        yield f"{hidden} of {total} marker readings are out of sight and count nothing"


def _knots(design: Design) -> Iterator[str]:
    problem = design.problem
    for effect in problem.model.effects:
        if isinstance(effect, StiffnessVsAngle) and effect.where not in problem.cell.knots:
            levels = design.levels
            if levels is not None and problem.cell.robot.joints[levels.joint] == effect.where:
                continue
            angles = ", ".join(f"{np.degrees(knot):.6g}" for knot in effect.knots)
            yield (
                f"stiffness_vs_angle:{effect.where} has its coefficients at {angles}; write them into "
                f"[model.knots_deg] as {effect.where} = [{angles}], so that other commands use the same"
            )


_NOTES = (_no_targets, _weak, _unmoved, _unguarded, _exempt, _hidden, _knots)
