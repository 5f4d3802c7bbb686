"""What readings to come would show: whitened rows of every parameter, the rivals' among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell, Load
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import depends_on
from calib.effects.protocol import Effect
from calib.model import Model
from calib.observations import Points
from calib.poses import Poses
from calib.scatter import Variances, scatter_of
from doe.constraints import constraints_of, scene_of, visible
from doe.discriminate.session import Hung, Session, session_of
from doe.problem.levels import Levels, levels_of
from doe.problem.pool import rounded

_DRAWN = 8192
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class Situation:
    """A cell, a linearised model, and the conditions of the readings to come.

    model : Model, with everything that was found and all rivals; values : ndarray, shape (p,)
    factor : float, actual over stated noise; sigma : float, m, usual standard deviation of a point
        where the data give their own, else NaN
    levels : Levels, to which the cell's design and the data keep, or None
    silent : tuple of Effect, that readings from this station do not have
    scatter : Variances, how readings of one configuration err together beside the instrument
    """

    cell: Cell
    model: Model
    values: Array
    session: Session
    factor: float
    sigma: float
    levels: Levels | None = None
    silent: tuple[Effect, ...] = ()
    scatter: Variances | None = None

    def rows(self, q: Array, poses: Poses) -> Array:
        """Independent rows of configurations (m, dof), read as ``poses`` say, shape (m, r, p)."""
        model = replace(
            self.model
        )  # a model of its own: the last linearisation is no use to others
        points, J = model.jacobian(self.values, poses)
        sigma = np.full(points.shape[:-1], self.sigma)
        seen = np.repeat(visible(scene_of(self.cell, q)), self.session.each, axis=0)
        W = model.readout.whitening(self.values, poses, points, sigma) / self.factor
        weighted = (W @ J) * seen[..., None, None]
        for effect, part in zip(model.effects, model.slices, strict=True):
            if any(effect is other for other in self.silent):
                weighted[..., part] = 0.0
        rows = weighted.reshape(len(poses), -1, J.shape[-1])
        if self.scatter is not None and self.scatter.any:
            err = scatter_of(model, self.values, poses, self.scatter)
            approach = np.repeat(np.arange(len(poses) // self.session.stay), self.session.stay)
            visit = np.repeat(np.arange(len(q)), self.session.each)
            err = replace(err, approach=approach, configuration=visit)
            levers = (W @ err.levers) * seen[..., None, None]
            rows = err.mixing(levers.reshape(*rows.shape[:2], -1))(rows)
        return np.asarray(rows.reshape(len(q), -1, J.shape[-1]))

    def in_order(self, q: Array) -> Array:
        """Rows of configurations read one after the other, shape (m, r, p)."""
        return self.rows(q, self.session.in_order(self.model.robot, q))

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
        """Configurations over the joint box: plain draws, as the import of Sobol's takes longer."""
        low, high = self.cell.robot.sample_limits().T
        q = rounded(self.cell, rng.uniform(low, high, (_CHUNK, len(low))))
        if self.levels is not None:
            q[:, self.levels.joint] = rng.choice(self.levels.values, _CHUNK)
        return q

    def allowed(self, q: Array) -> Array:
        """The configurations of (m, dof) that the cell allows under every load."""
        for load in self.session.loads:
            for constraint in constraints_of(self._loaded(load)):
                q = q[constraint.allows(scene_of(self.cell, q))] if len(q) else q
        return q

    def _loaded(self, load: Hung) -> Cell:
        """The cell with this load hanging, as its constraints are asked."""
        if load.free:
            return replace(self.cell, load=None)
        pull = float(np.linalg.norm(self.cell.gravity)) or 9.80665
        mass = load.mass + float(np.linalg.norm(load.force)) / pull
        x, y, z = load.com if load.mass else load.lever
        tilt = np.pi / 2 if self.cell.load is None else self.cell.load.max_tilt
        return replace(self.cell, load=Load(mass, (float(x), float(y), float(z)), tilt))


def situation_of(cell: Cell, diagnosis: Diagnosis, rivals: Sequence[Effect]) -> Situation:
    """The data's own situation, linearised at the final fit; ``rivals`` beyond it at zero."""
    after, data = diagnosis.after, diagnosis.data
    model, values = after.model.extended(after.values, rivals)
    given = data.sigma[np.isfinite(data.sigma) & data.seen]
    return Situation(
        cell,
        model,
        values,
        session_of(cell.robot, data.poses),
        diagnosis.noise.factor,
        float(np.median(given)) if len(given) else np.nan,
        _kept_levels(cell, data.poses.q),
        # The factor stands for the instrument already.
        scatter=None if after.levels is None else replace(after.levels.variances, scale=1.0),
    )


def _kept_levels(cell: Cell, q: Array) -> Levels | None:
    """The levels of the cell's design, where the data (m, dof) stand at them."""
    levels = levels_of(cell, None, None)
    return levels if levels is not None and (levels.of(q) >= 0).all() else None


def data_rows(situation: Situation, diagnosis: Diagnosis) -> tuple[Array, Array]:
    """Residual (N,) and independent rows (N, p) of the data, as the final fit weighs them."""
    data, after = diagnosis.data, diagnosis.after
    stage = diagnosis.stage
    W = stage.weights / diagnosis.scale * (after.weight * ~stage.dropped)[:, None, None, None]
    predicted, J = situation.model.jacobian(situation.values, data.poses)
    points = Points(situation.model, data, W)
    rows = points.rows(J)
    off = points.rows(situation.model.readout.difference(data.readings, predicted)[..., None])
    if after.mixing is not None:
        rows, off = after.mixing(rows), after.mixing(off)
    return off.ravel(), rows.reshape(-1, rows.shape[-1])


@dataclass(frozen=True, eq=False)
class Offer:
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


def offer_of(situation: Situation, q: Array, count: int) -> Offer:
    """Rows of candidates (m, dof), each as one among ``count`` poses to come."""
    model, session = situation.model, situation.session
    robot = model.robot
    joint = np.zeros(len(model.parameters), dtype=int)
    sided = False
    for effect, part in zip(model.effects, model.slices, strict=True):
        variable, _, name = depends_on(effect).partition(":")
        if variable == "approach" and name in robot.joints:
            joint[part], sided = robot.joints.index(name), True
    right = situation.rows(q, session.alike(robot, q, 1.0, count))
    if not sided or session.sides:
        return Offer(q, right, None, joint)
    left = situation.rows(q, session.alike(robot, q, -1.0, count))
    return Offer(q, 0.5 * (right + left), 0.5 * (right - left), joint)
