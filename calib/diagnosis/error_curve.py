"""The error of a place as a curve: by how much it is off, over what that depends on.

A line through a few knots is fitted in place of the effect that was found, without a penalty. Where
both agree, the effect has the right shape. Part of a line may be known to nobody: a constant error of a
joint is an error of geometry as well. What the other modelled effects can absorb is taken out of the
line and of the effect alike, each coefficient weighed as the data see it; what is left is compared.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.curves import TwistCurve
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.functions import PoseVariable, polyline, pose_variables
from calib.diagnosis.prior import prior_rows
from calib.diagnosis.stage import determined_by
from calib.effects.drive import along_axis
from calib.effects.protocol import PoseEffect, State, TwistEffect, displaced
from calib.linear import orthonormal
from calib.model import Model
from calib.model.covariance import covariance
from calib.poses import Poses
from calib.solver import levenberg_marquardt

_BESIDE = 1e-6  # share of a squared displacement that counts as none
_ARM = 0.3  # m, at which a rotation counts as much as a shift


def frame_of(where: str, robot: Robot) -> int | None:
    """Number of the frame that is displaced at a place, None where it is no single one."""
    if where in robot.joints:
        return robot.joints.index(where) + 1
    return {"base": 0, "tool": robot.tip_frame}.get(where)


def displacement_of(candidate: Candidate, values: Array, frame: int, state: State) -> Array | None:
    """Displacement of a frame by an effect at its values (p,), shape (m, 6), SI.

    None where the effect acts otherwise: a load, a reading.
    """
    effect = candidate.effect
    if not isinstance(effect, TwistEffect):
        return None
    if isinstance(effect, PoseEffect):
        moved = effect.displacements(state.poses, values)
    else:
        moved = displaced(effect.twists(state, values), values)
    own = [xi for at, xi in moved if at == frame]
    return np.sum([np.broadcast_to(b, (len(state.poses), 6)) for b in own], axis=0) if own else None


def directions_of(where: str, moved: Array | None, frame: int, robot: Robot, state: State) -> Array:
    """Directions in which a place is off, shape (6, c), orthonormal, in the axes of its frame.

    A joint is off along its axis, or across it where it is displaced so. The first direction across is
    that about which the moment varies most.
    moved : ndarray, shape (m, 6), by which the frame is displaced, if that is known
    """
    if where not in robot.joints:
        return np.eye(6)
    axis = along_axis(robot, robot.joints.index(where))
    if moved is None or axis[:3].any():
        return axis[:, None]
    beside = moved - np.outer(moved @ axis, axis)
    if float((beside**2).sum()) <= _BESIDE * float((moved**2).sum()):
        return axis[:, None]
    across = np.eye(3) - np.outer(axis[3:], axis[3:])
    moments = state.wrench.local[:, frame, 3:] @ across
    # A little of the frame's own axes decides where no moment varies.
    _, _, Vt = np.linalg.svd(np.concatenate([moments - moments.mean(axis=0), 1e-9 * across]))
    tilts = np.column_stack([Vt[0], np.cross(axis[3:], Vt[0])])
    return np.concatenate([np.zeros((3, 2)), tilts])


def variable_of(
    depends_on: str, load: Array, frame: int, robot: Robot, state: State
) -> Array | None:
    """Value at each pose of what an error depends on, shape (m,), SI; None where it is no number.

    load : ndarray, shape (6,), component of the wrench that stands for the load
    """
    if depends_on == "load":
        return np.asarray(state.wrench.local[:, frame] @ load)
    known = pose_variables(robot, state.poses).get(depends_on)
    return None if known is None else known.at(state.poses)


def load_of(moved: Array | None, directions: Array, frame: int, state: State) -> Array:
    """Component of the wrench at a frame over which its error is drawn, shape (6,), a unit vector.

    For a joint that along its first direction; for base and tool the one that the displacement follows
    best, or that varies most where no displacement is known.
    """
    if directions.shape[1] < len(directions):
        return directions[:, 0]
    wrench = state.wrench.local[:, frame] - state.wrench.local[:, frame].mean(axis=0)
    size = np.maximum(np.linalg.norm(wrench, axis=0), 1e-12)
    if moved is None:
        return np.asarray(np.eye(6)[int(np.argmax(size))])
    lengths = moved * np.where(np.arange(6) < 3, 1.0, _ARM)
    followed = np.linalg.norm((wrench / size).T @ lengths, axis=1)
    return np.asarray(np.eye(6)[int(np.argmax(followed))])


_KNOTS = 8
_ABSORBED = (
    0.03  # share of a coefficient's length that the other effects leave, below which it goes
)
_STEPS = 10  # of the grid between two knots
_FUNCTION = 0.05  # scatter, over size, of what still counts as a function of the variable


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """The error of a place in c directions, SI, less what the other effects absorb.

    candidate : Candidate, that was found
    directions : ndarray, shape (6, c), in the axes of the place's frame
    load : ndarray, shape (6,), component of the wrench where that is the variable, else None
    poses : Poses, the m of the data; variable : ndarray, shape (m,)
    knots : ndarray, shape (K,); grid : ndarray, shape (g,), of the variable
    value, std : ndarray, shape (g, c), the curve and its standard deviation on the grid
    at_poses, std_at_poses : ndarray, shape (m, c), the same at the poses
    single : ndarray, shape (m, c), what each pose says by itself (partial residuals); NaN where a pose
        was left out or has too few points
    effect : ndarray, shape (m, c), the effect that was found, at each pose
    function : tuple of bool, for each direction, whether that depends on the variable alone
    absorbed : int, combinations of coefficients that were taken out
    converged : bool, whether the fit of the curve reached its minimum
    """

    candidate: Candidate
    directions: Array
    load: Array | None
    poses: Poses
    variable: Array
    knots: Array
    grid: Array
    value: Array
    std: Array
    at_poses: Array
    std_at_poses: Array
    single: Array
    effect: Array
    function: tuple[bool, ...]
    absorbed: int
    converged: bool


def error_curve(result: Diagnosis, candidate: Candidate) -> ErrorCurve | None:
    """The error of a place as a fitted line over the variable that a cause depends on.

    None where its place is no single frame (the arm as a whole, the instrument), where it depends on
    nothing that varies, or for what is too fine to be drawn: a gear ripple stands in the spectra.
    """
    after, poses = result.after, result.data.poses
    robot = after.model.robot
    frame = frame_of(candidate.where, robot)
    if frame is None or not candidate.effect.drawn:
        return None
    state = after.model.state(after.values, poses)
    values = after.values[after.positions(candidate.effect)]
    moved = displacement_of(candidate, values, frame, state)
    directions = directions_of(candidate.where, moved, frame, robot, state)
    load = load_of(moved, directions, frame, state)
    variable = variable_of(candidate.depends_on, load, frame, robot, state)
    function = None if variable is None else polyline(variable[~result.waiting], _KNOTS)
    if variable is None or function is None:
        return None
    given = _GivenVariable(candidate.depends_on, variable)
    line = TwistCurve(candidate.where, frame, directions, given, function)
    hats, knots = line.basis(poses), function.knots
    effect = _alike(result, candidate, line) if moved is None else moved @ directions
    h = np.asarray(np.linalg.lstsq(hats, effect, rcond=None)[0].T.ravel(), dtype=np.float64)
    fit = _fitted(result, candidate, line, h)
    g, cov = fit.values[-len(h) :], fit.covariance[-len(h) :, -len(h) :]
    parts = [np.linspace(a, b, _STEPS, endpoint=False) for a, b in itertools.pairwise(knots)]
    grid = np.append(np.concatenate(parts), knots[-1])
    value, std = _evaluated(function.at(grid), g, cov)
    at_poses, std_at_poses = _evaluated(hats, g, cov)
    # What each pose's residual says of the line there.
    seen: Mask = np.logical_and(result.data.seen, ~result.outlier[:, None])
    residual = fit.model.off(fit.values, result.data)
    single = _as_error(fit.model, fit.values, line, poses, residual, seen)
    single[~np.any(seen, axis=1)] = np.nan
    lost: Array = h - fit.projection @ h
    absorbed, _ = _evaluated(hats, lost, cov)
    return ErrorCurve(
        candidate=candidate,
        directions=directions,
        load=load if candidate.depends_on == "load" else None,
        poses=poses,
        variable=variable,
        knots=knots,
        grid=grid,
        value=value,
        std=std,
        at_poses=at_poses,
        std_at_poses=std_at_poses,
        single=at_poses + single,
        effect=effect - absorbed,
        function=tuple(_is_function(variable, column) for column in effect.T),
        absorbed=fit.absorbed,
        converged=fit.converged,
    )


@dataclass(frozen=True, eq=False)
class _GivenVariable(PoseVariable):
    """A variable by its values, shape (m,), at the poses in hand."""

    values: Array

    def at(self, poses: Poses) -> Array:
        return self.values


class _LineFit(NamedTuple):
    """A model whose last effect is a line, fitted.

    projection : ndarray, shape (K, K), of its coefficients onto what only they explain
    absorbed : int, the projection's deficit
    """

    model: Model
    values: Array
    covariance: Array
    projection: Array
    absorbed: int
    converged: bool


def _fitted(result: Diagnosis, candidate: Candidate, line: TwistCurve, h: Array) -> _LineFit:
    """Fit a line in place of an effect, from where the effect was.

    h : ndarray, shape (K,), coefficients with which the line is about the effect
    The rest of the model keeps all directions that it can have without either; the line gets those that
    are left, so that none of its coefficients is arbitrary.
    """
    from scipy.linalg import block_diag

    after, stage = result.after, result.stage
    others = tuple(e for e in after.model.effects if e is not candidate.effect)
    rest = np.delete(after.values, after.positions(candidate.effect))
    alone = stage.observation(after.model.with_effects(others), after.weight)
    seen = determined_by(alone, rest)
    held = np.pad(prior_rows(alone.model, after.amplitudes), ((0, 0), (0, len(h))))
    model = after.model.with_effects((*others, line))
    observation = replace(stage.observation(model, after.weight), prior=held)
    _, J = observation.flat(np.append(rest, h))
    Q, X = orthonormal(J[:, : len(rest)] @ seen), J[:, len(rest) :]
    lengths = np.linalg.norm(X, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    left = (X - Q @ (Q.T @ X)) / lengths
    eigenvalues, V = np.linalg.eigh(left.T @ left)
    V = V[:, eigenvalues > _ABSORBED**2]
    span = block_diag(seen, V / lengths[:, None])
    projection = (V @ V.T) * lengths / lengths[:, None]
    found = levenberg_marquardt(observation.flat, np.append(rest, projection @ h), span)
    cov = result.scale**2 * covariance(observation.flat(found.values)[1], span)
    absorbed = len(h) - V.shape[1]
    return _LineFit(model, found.values, cov, projection, absorbed, bool(found.converged))


def _alike(result: Diagnosis, candidate: Candidate, line: TwistCurve) -> Array:
    """The displacement of a line's frame that moves the markers most as an effect does, (m, c)."""
    after, poses = result.after, result.data.poses
    without = after.values.copy()
    without[after.positions(candidate.effect)] = 0.0
    shift = after.model.predict(after.values, poses) - after.model.predict(without, poses)
    model, values = after.model.extended(after.values, [line])
    return _as_error(model, values, line, poses, shift, np.ones(shift.shape[:2], dtype=bool))


def _as_error(
    model: Model, values: Array, line: TwistCurve, poses: Poses, moved: Array, seen: Mask
) -> Array:
    """Least-squares displacement of a line's frame that moves the markers so, shape (m, c).

    model : Model, whose last effect is the line
    moved : ndarray, shape (m, C, r); seen : ndarray of bool, shape (m, C)
    NaN at poses with fewer coordinates than directions.
    """
    c = line.directions.shape[1]
    _, J = model.jacobian(values, poses)
    # The hats add up to one: so do the columns to a displacement of the frame alone.
    D = J[..., -len(line.parameters) :].reshape((*J.shape[:-1], c, -1)).sum(axis=-1)
    D = np.where(seen[..., None, None], D, 0.0).reshape(len(poses), -1, c)
    rows = np.where(seen[..., None], moved, 0.0).reshape(len(poses), -1, 1)
    found = (np.linalg.pinv(D) @ rows)[..., 0]
    told = (seen * model.readout.channels.rows).sum(axis=1) >= c
    return np.where(told[:, None], found, np.nan)


def _evaluated(hats: Array, g: Array, cov: Array) -> tuple[Array, Array]:
    """Value and standard deviation, each shape (.., c), of a line with coefficients g."""
    K = hats.shape[1]
    c = len(g) // K
    blocks = [cov[i * K : (i + 1) * K, i * K : (i + 1) * K] for i in range(c)]
    variance = np.stack([np.einsum("ik,kl,il->i", hats, block, hats) for block in blocks], axis=-1)
    return hats @ g.reshape(c, K).T, np.sqrt(np.maximum(variance, 0.0))


def _is_function(variable: Array, error: Array) -> bool:
    """Whether an error (m,) follows from the variable alone: neighbours predict what lies between."""
    distinct, group = np.unique(np.round(variable, 9), return_inverse=True)
    means = np.bincount(group, error) / np.bincount(group)
    within = np.abs(error - means[group])
    between = np.abs(np.interp(distinct[1:-1:2], distinct[::2], means[::2]) - means[1:-1:2])
    scatter = max(float(within.max()), float(np.quantile(between, 0.8)) if len(between) else 0.0)
    return scatter <= _FUNCTION * float(np.ptp(error))
