"""What is known now, and the rows that readings to come would add.

A model is linearised about what is known of it. The readings in hand, or those of a plan, are
independent rows of unit variance, ``V^-1/2 J`` with V the covariance by instrument and arm. A
configuration to come brings rows of the same kind, under the conditions in which it will be read. All
that is asked stands on these two: the error at the targets (:mod:`~doe.ahead.accuracy`), which causes
are found (:mod:`~doe.ahead.foresee`), which are told apart and of what form they are
(:mod:`~doe.ahead.causes`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray, Mask, in_parts
from calib.cell import Cell, Load
from calib.diagnosis import Diagnosis
from calib.diagnosis.stage import Fit
from calib.effects.protocol import Effect
from calib.identification import Identification
from calib.instruments import Camera
from calib.linear import LinearProblem
from calib.model import Model
from calib.observations import Points
from calib.poses import Measurements, Poses
from doe.ahead.coming import Conditions, TipLoad, conditions_of
from doe.constraints import constraints_of, scene_of, visible
from doe.problem.levels import levels_of
from doe.problem.linearisation import Linearisation
from doe.problem.pool import drawn

_DRAWN = 8192
_FEW_ROWS = 12  # of a configuration, which are not worth condensing
_ROUNDING = 1e-12  # of the largest singular value of all
_MANY = 2  # rows of a configuration for each parameter, beyond which their triangle stands for them


@dataclass(frozen=True, eq=False)
class Forecast(Linearisation):
    """A model to first order, what is known of it, and the conditions of the readings to come.

    data : Measurements, the readings in hand; known : LinearProblem, of them and what is known beside
    conditions : Conditions, of those to come
    """

    data: Measurements = field(kw_only=True)
    known: LinearProblem = field(kw_only=True)
    conditions: Conditions = field(kw_only=True)

    @classmethod
    def after(cls, at: Linearisation, known: LinearProblem, data: Measurements) -> Self:
        """With further readings under the conditions of ``data``, which are known to first order."""
        off, held = at.model.prior_residuals(at.values)
        known = replace(known, off=off, held=held)
        conditions = conditions_of(at.model.robot, data.poses)
        return cls(**vars(at), data=data, known=known, conditions=conditions)

    @classmethod
    def after_diagnosis(cls, cell: Cell, diagnosis: Diagnosis, rivals: Sequence[Effect]) -> Self:
        """At the final fit, with its weights, beside ``rivals`` beyond it at zero."""
        data, after, stage = diagnosis.data, diagnosis.after, diagnosis.stage
        model, values = after.model.extended(after.values, rivals)
        arm = replace(after.variances, scale=diagnosis.noise.factor)
        W = stage.weights / diagnosis.scale * (after.weight * ~stage.dropped)[:, None, None, None]
        rows = Points(model, data, W).whitened(values)
        known = LinearProblem(*rows, np.eye(len(values)), mixing=after.mixing)
        return cls.after(Linearisation(as_found(cell, after), model, values, arm), known, data)

    def under(self, **changed: Any) -> Self:
        """The same where some of the conditions are changed."""
        return replace(self, conditions=replace(self.conditions, **changed))

    def with_model(self, model: Model, values: Array, at: IntArray) -> Self:
        """The same with other parameters.

        at : ndarray of int, shape (p,), where each stands in the present model, -1 where it is none of
            its own: of that the readings in hand tell nothing
        """
        J, held = (
            np.concatenate([own, np.zeros((*own.shape[:-1], 1))], axis=-1)[..., at]
            for own in (self.known.J, self.known.held)
        )
        known = replace(self.known, J=J, held=held, span=np.eye(len(at)))
        return replace(self, model=model, values=values, known=known)

    def read(self, q: Array, poses: Poses) -> Array:
        """Independent rows of configurations (m, dof), read as ``poses`` say, shape (m, r, p).

        Where the arm stands no more, so soft would it be, they tell nothing.
        """
        each, p = self.conditions.each, len(self.values)
        numbers = int(self.model.readout.channels.rows.sum()) * each
        parts = in_parts(len(q), numbers * p)
        own = (poses.take(slice(part.start * each, part.stop * each)) for part in parts)
        return np.concatenate(
            [self._read(q[part], at) for part, at in zip(parts, own, strict=True)]
        )

    def _read(self, q: Array, poses: Poses) -> Array:
        conditions, reading = self.conditions, np.arange(len(poses))
        seen = np.repeat(visible(scene_of(self.cell, q)), conditions.each, axis=0)
        visit = reading // conditions.stay, reading // conditions.each
        given = self.data.sigma[np.isfinite(self.data.sigma) & self.data.seen]
        sigma = float(np.median(given)) if len(given) else np.nan
        rows = self.candidates(poses, seen, visit, sigma).by_reading
        rows = rows.reshape(len(q), -1, rows.shape[-1])
        rows = np.where(np.isfinite(rows).all(axis=(1, 2), keepdims=True), rows, 0.0)
        many = rows.shape[1] > _MANY * rows.shape[2]
        return np.asarray(np.linalg.qr(rows, mode="r")) if many else rows

    def in_order(self, q: Array) -> Array:
        """Rows of configurations read one after the other, shape (m, r, p)."""
        return self.read(q, self.conditions.in_order(self.model.robot, q))

    def offered(self, q: Array, count: int) -> Offer:
        """Candidates (m, dof) with their rows, each as one among ``count`` poses to come."""
        robot, parameters = self.model.robot, len(self.model.parameters)
        joint, sided = np.zeros(parameters, dtype=int), False
        for effect, part in self.model.parts:
            variable, _, name = effect.depends_on.partition(":")
            if variable == "approach" and name in robot.joints:
                joint[part], sided = robot.joints.index(name), True
        right = self.read(q, self.conditions.alike(robot, q, 1.0, count))
        if not sided or self.conditions.sides:
            return Offer(q, right)
        left = self.read(q, self.conditions.alike(robot, q, -1.0, count))
        return Offer(q, right, left, joint)

    def feasible(self, count: int, seed: int) -> Array:
        """Up to ``count`` configurations that the cell allows, under every load, (m, dof).

        They keep to the levels of the cell's design where the readings in hand do.
        """
        levels, found = levels_of(self.cell, None, None), list[Array]()
        if levels is not None and (levels.of(self.data.poses.q) < 0).any():
            levels = None
        for visits in drawn(self.cell, _DRAWN, levels, seed):
            found.append(self.allowed(visits.q))
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]

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


def as_found(cell: Cell, after: Fit | Identification) -> Cell:
    """The cell with its cameras where they were found: what they see of other poses hangs on that."""
    if not any(isinstance(i, Camera) for i in cell.instruments):
        return cell
    placed = after.model.readout.placed(cell.instruments, after.values)
    return replace(cell, instruments=placed, markers=after.model.marker_positions(after.values))


@dataclass(frozen=True, eq=False)
class Offer:
    """Candidates with their rows, by the side from which each joint comes.

    q : ndarray, shape (m, dof)
    right, left : ndarray, shape (m, r, p), of joints that rise, and that fall; left is None where no
        column depends on the approach
    joint : ndarray of int, shape (p,), whose side counts for a column
    """

    q: Array
    right: Array
    left: Array | None = None
    joint: IntArray | None = None

    def __len__(self) -> int:
        return len(self.q)

    def rows(self, index: IntArray | slice, before: Array) -> Array:
        """Rows of candidates that are reached from joint values ``before`` (dof,)."""
        if self.left is None:
            return self.right[index]
        rising = (self.q[index] >= before)[:, self.joint]
        return np.where(rising[:, None, :], self.right[index], self.left[index])

    @cached_property
    def condensed(self) -> Offer:
        """The same candidates with no more rows than tell anything: what rows add depends on ``A^T A``.

        A camera's image is of a hundred rows and tells of a dozen directions.
        """
        if self.right.shape[1] <= _FEW_ROWS:
            return self
        both = self.right if self.left is None else np.concatenate([self.right, self.left], axis=2)
        U, s, _ = np.linalg.svd(both, full_matrices=False)
        told = s > _ROUNDING * s.max(initial=0.0)
        turn = np.swapaxes(U[..., : int(told.sum(axis=1).max(initial=0))], 1, 2)
        left = None if self.left is None else turn @ self.left
        return Offer(self.q, turn @ self.right, left, self.joint)

    def take(self, index: Sequence[int]) -> Offer:
        """Some of the candidates."""
        left = None if self.left is None else self.left[index]
        return Offer(self.q[index], self.right[index], left, self.joint)


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
