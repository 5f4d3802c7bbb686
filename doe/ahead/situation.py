"""Poses that may be read next: where the cell allows them, and what each of them would show."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell, Load
from calib.cell.views import NUMBERS
from calib.poses import Measurements, Poses
from doe.ahead.conditions import Conditions, TipLoad, conditions_of
from doe.constraints import constraints_of, scene_of, visible
from doe.problem.levels import AngleLevels, levels_of
from doe.problem.linearisation import Linearisation
from doe.problem.pool import in_turn_brought, rounded

_DRAWN = 8192
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class Situation(Linearisation):
    """A model to first order, and the conditions of the readings to come.

    sigma : float, m, usual standard deviation of a point where readings give their own, else NaN
    levels : AngleLevels, to which the cell's design and the readings keep, or None
    """

    conditions: Conditions = field(kw_only=True)
    sigma: float = field(kw_only=True)
    levels: AngleLevels | None = field(kw_only=True)

    def under(self, **changed: Any) -> Self:
        """The same where some of the conditions are changed."""
        return replace(self, conditions=replace(self.conditions, **changed))

    def read(self, q: Array, poses: Poses) -> Array:
        """Independent rows of configurations (m, dof), read as ``poses`` say, shape (m, r, p)."""
        conditions, reading = self.conditions, np.arange(len(poses))
        seen = np.repeat(visible(scene_of(self.cell, q)), conditions.each, axis=0)
        visit = reading // conditions.stay, reading // conditions.each
        rows = self.candidates(poses, seen, visit, self.sigma).by_reading
        return rows.reshape(len(q), -1, rows.shape[-1])

    def in_order(self, q: Array) -> Array:
        """Rows of configurations read one after the other, shape (m, r, p)."""
        return self.read(q, self.conditions.in_order(self.model.robot, q))

    def feasible(self, count: int, seed: int) -> Array:
        """Up to ``count`` configurations that the cell allows, under every load, (m, dof)."""
        rng = np.random.default_rng(seed)
        found: list[Array] = []
        for _ in range(_DRAWN // _CHUNK):
            found.append(self.allowed(self._anywhere(rng)))
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]

    def _anywhere(self, rng: np.random.Generator) -> Array:
        """Configurations over the joint box, drawn by chance."""
        low, high = self.cell.robot.sample_limits().T
        q = rounded(self.cell, rng.uniform(low, high, (_CHUNK, len(low))))
        if self.levels is not None:
            q[:, self.levels.joint] = rng.choice(self.levels.values, _CHUNK)
        even = rng.uniform(size=(_CHUNK, NUMBERS))
        return in_turn_brought(self.cell, self.cell.robot.tied(q), even, self.levels)

    def allowed(self, q: Array) -> Array:
        """The configurations of (m, dof) that the cell allows under every load."""
        for load in self.conditions.loads:
            for constraint in constraints_of(self._loaded(load)):
                q = q[constraint.allows(scene_of(self.cell, q))] if len(q) else q
        return q

    def _loaded(self, load: TipLoad) -> Cell:
        """The cell with this load hanging, as its constraints are asked."""
        if load.free:
            return replace(self.cell, load=None)
        mass = load.mass_under(self.cell.gravity)
        x, y, z = load.com if load.mass else load.lever
        tilt = np.pi / 2 if self.cell.load is None else self.cell.load.max_tilt
        return replace(self.cell, load=Load(mass, (float(x), float(y), float(z)), tilt))


def situation_of(at: Linearisation, data: Measurements) -> Situation:
    """Further readings under the conditions of given ones."""
    given = data.sigma[np.isfinite(data.sigma) & data.seen]
    levels = levels_of(at.cell, None, None)
    return Situation(
        at.cell,
        at.model,
        at.values,
        at.arm,
        conditions=conditions_of(at.model.robot, data.poses),
        sigma=float(np.median(given)) if len(given) else np.nan,
        levels=levels if levels is not None and (levels.of(data.poses.q) >= 0).all() else None,
    )


@dataclass(frozen=True, eq=False)
class CandidateRows:
    """Candidates with their rows, by the side from which each joint comes.

    q : ndarray, shape (m, dof)
    mean, half : ndarray, shape (m, r, p): rows are ``mean + sign half``; half is None where no column
        depends on the approach
    joint : ndarray of int, shape (p,), whose sign counts for a column
    """

    q: Array
    mean: Array
    half: Array | None
    joint: IntArray

    def __len__(self) -> int:
        return len(self.q)

    def rows(self, index: IntArray | slice, before: Array) -> Array:
        """Rows of candidates that are reached from joint values ``before`` (dof,)."""
        if self.half is None:
            return self.mean[index]
        sign = np.where(self.q[index] >= before, 1.0, -1.0)[:, self.joint]
        return np.asarray(self.mean[index] + sign[:, None, :] * self.half[index])


def candidate_rows(situation: Situation, q: Array, count: int) -> CandidateRows:
    """Rows of candidates (m, dof), each as one among ``count`` poses to come."""
    model, conditions = situation.model, situation.conditions
    robot = model.robot
    joint = np.zeros(len(model.parameters), dtype=int)
    sided = False
    for effect, part in zip(model.effects, model.slices, strict=True):
        variable, _, name = effect.depends_on.partition(":")
        if variable == "approach" and name in robot.joints:
            joint[part], sided = robot.joints.index(name), True
    right = situation.read(q, conditions.alike(robot, q, 1.0, count))
    if not sided or conditions.sides:
        return CandidateRows(q, right, None, joint)
    left = situation.read(q, conditions.alike(robot, q, -1.0, count))
    return CandidateRows(q, 0.5 * (right + left), 0.5 * (right - left), joint)


def likely_read(robot: Robot, q: Array, read: Poses, missed: Poses | None) -> Mask:
    """Configurations (m, dof) whose nearest tried one, over the joints' ranges, could be read, (m,).

    What hides a marker or bars the way is seldom a point; how far it goes nobody has said. All, where
    none was missed.
    """
    if missed is None or not len(missed):
        return np.ones(len(q), dtype=bool)
    low, high = robot.sample_limits().T
    span = np.where(high > low, high - low, 1.0)
    return np.asarray(_nearest(q / span, read.q / span) < _nearest(q / span, missed.q / span))


def _nearest(q: Array, others: Array) -> Array:
    """Squared distance of each of (m, dof) to the nearest of others (n, dof), shape (m,)."""
    if not len(others):
        return np.full(len(q), np.inf)
    return np.asarray(((q[:, None] - others) ** 2).sum(axis=-1).min(axis=1))


def refusal(missed: Poses | None) -> str:
    """Why no configuration is left to propose."""
    if missed is None or not len(missed):
        return "no configuration satisfies the cell's constraints; relax [design]"
    return (
        f"all candidates are nearer to one of {len(missed)} missed poses than to any that was read; "
        "leave out those that were missed by accident"
    )
