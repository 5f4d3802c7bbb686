"""The error of a place as a curve: by how much it is off, over what that depends on.

A line through a few knots stands in place of the effect that was found, without a penalty, to first
order about the fit. Where both agree, the effect has the right shape. Part of a line may be known to
nobody: a constant error of a joint is an error of geometry as well. What the other modelled effects can
absorb is taken out of the line and of the effect alike, each coefficient weighed as the data see it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.functions import polyline, pose_variables
from calib.diagnosis.prior import prior_rows
from calib.diagnosis.stage import determined_by
from calib.effects.joint import along_axis
from calib.effects.protocol import (
    FrameEffect,
    Parameter,
    PoseEffect,
    State,
    TwistEffect,
    displaced,
)
from calib.effects.ripple import GearRipple
from calib.identification.scan import times
from calib.model import Model
from calib.observations.linear import LinearProblem
from calib.poses import Poses
from calib.solver import least_squares

_KNOTS = 8
_STEPS = 10  # of the grid between two knots
_BESIDE = 1e-6  # share of a squared displacement that counts as none
_ARM = 0.3  # m, at which a rotation counts as much as a shift
_FUNCTION = 0.05  # scatter, over size, of what still counts as a function of the variable
_ABSORBED = 0.03
"""Share of a coefficient's length that the other effects leave, below which it goes."""


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """The error of a place in c directions, SI, less what the other effects absorb.

    candidate : Candidate, that was found
    directions : ndarray, shape (6, c), in the axes of the place's frame
    load : ndarray, shape (6,), component of the wrench where that is the variable, else None
    poses : Poses, the m of the data; variable : ndarray, shape (m,)
    knots : ndarray, shape (K,); grid : ndarray, shape (g,), of the variable
    value, std : ndarray, shape (g, c), the curve and its standard deviation on the grid, NaN where no
        pose was read
    at_poses, std_at_poses : ndarray, shape (m, c), the same at the poses
    single : ndarray, shape (m, c), what each pose says by itself (partial residuals); NaN where a pose
        was left out or has too few points
    effect : ndarray, shape (m, c), the effect that was found, at each pose
    function : tuple of bool, for each direction, whether that depends on the variable alone
    absorbed : int, combinations of coefficients that were taken out
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


def error_curve(result: Diagnosis, candidate: Candidate) -> ErrorCurve | None:
    """The error of a place as a fitted line over the variable that a cause depends on.

    None where its place is no single frame (the arm as a whole, the instrument), where it depends on
    nothing that varies, or for what is too fine to be drawn: a gear ripple stands in the spectra.
    """
    after, data = result.after, result.data
    robot, poses = after.model.robot, data.poses
    frame = frame_of(candidate.where, robot)
    if frame is None or isinstance(candidate.effect, GearRipple):
        return None
    state = after.model.state(after.values, poses)
    values = after.values[after.positions(candidate.effect)]
    moved = _displacement(candidate, values, frame, state)
    directions = _directions(candidate.where, moved, frame, robot, state)
    load = _load(moved, directions, frame, state)
    variable = _variable(candidate.depends_on, load, frame, robot, state)
    function = None if variable is None else polyline(variable[~result.waiting], _KNOTS)
    if variable is None or function is None:
        return None
    hats = function.at(variable)
    line = _fitted(result, candidate, frame, directions, hats)
    effect = line.like_effect if moved is None else moved @ directions
    h = np.linalg.lstsq(hats, effect, rcond=None)[0]
    knots, ends = function.knots, np.arange(len(function.knots))
    grid = np.interp(np.linspace(0.0, ends[-1], ends[-1] * _STEPS + 1), ends, knots)
    on_grid = function.at(grid)
    value, std = line.at(on_grid)
    unseen = on_grid[:, ~hats.any(axis=0)].any(axis=1)  # beside knots where no pose was read
    value[unseen] = std[unseen] = np.nan
    at_poses, std_at_poses = line.at(hats)
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
        single=at_poses + line.left,
        effect=effect - hats @ (h - (line.projection @ h.ravel()).reshape(h.shape)),
        function=tuple(_is_function(variable, column) for column in effect.T),
        absorbed=h.size - round(float(np.trace(line.projection))),
    )


class _Line(NamedTuple):
    """A line of K knots in c directions in place of an effect.

    values : ndarray, shape (K, c); covariance : ndarray, shape (K, c, K, c)
    projection : ndarray, shape (K c, K c), of its coefficients onto what only they explain
    left : ndarray, shape (m, c), that of each pose beside the line, NaN where none is told
    like_effect : ndarray, shape (m, c), displacement that moves the readings most as the effect does
    """

    values: Array
    covariance: Array
    projection: Array
    left: Array
    like_effect: Array

    def at(self, hats: Array) -> tuple[Array, Array]:
        """Value and standard deviation, each shape (.., c), at basis functions (.., K)."""
        variance = np.einsum("ik,kclc,il->ic", hats, self.covariance, hats, optimize=True)
        return hats @ self.values, np.sqrt(np.maximum(variance, 0.0))


def _fitted(
    result: Diagnosis, candidate: Candidate, frame: int, directions: Array, hats: Array
) -> _Line:
    """Fit a line with basis functions (m, K) in place of an effect.

    The rest of the model keeps all directions that it can have without either; the line gets those that
    are left, so that none of its coefficients is arbitrary.
    """
    after, data = result.after, result.data
    own = after.positions(candidate.effect)
    model, rest = after.model.without([candidate.effect], after.values)
    alone = result.stage.observation(model)
    span = determined_by(alone, rest)
    alone = replace(alone, prior=prior_rows(model, after.amplitudes))
    _, J = _with_frame(after.model, frame).jacobian(
        np.append(after.values, np.zeros(6)), data.poses
    )
    moves, by_rest = J[..., -6:] @ directions, np.delete(J[..., :-6], own, axis=-1)
    shift = J[..., own] @ after.moving[own]
    r = after.r + alone.rows(shift[..., None])[..., 0]
    known = alone.stated_prior_residuals(rest)
    problem = LinearProblem(r, alone.rows(by_rest), span, *known)
    columns = times(alone.rows(moves), hats)
    g, cov, projection = _beside(problem, columns)
    line = np.pad(stacked(columns) @ g, (0, len(known[0])))
    step = span @ least_squares(problem.fitted[0] - line, problem.fitted[1] @ span)
    shape = (hats.shape[1], directions.shape[1])
    moved = (moves @ (hats @ g.reshape(shape))[:, None, :, None])[..., 0]
    left = after.model.off(after.values, data) + shift - by_rest @ step - moved
    seen: Mask = np.logical_and(data.seen, ~result.outlier[:, None])
    return _Line(
        g.reshape(shape),
        (result.scale**2 * cov).reshape(shape * 2),
        projection,
        _as_error(moves, left, seen),
        _as_error(moves, shift, np.ones_like(seen)),
    )


def _beside(problem: LinearProblem, columns: Array) -> tuple[Array, Array, Array]:
    """Coefficients (k,) of whitened columns (m, R, k) beside a problem, in what only they explain.

    Also their covariance for noise of one, and the projection onto that, both (k, k).
    """
    lengths = np.linalg.norm(columns, axis=(0, 1))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    X = problem.complement.columns(columns) / lengths
    d, V = np.linalg.eigh(X.T @ X)
    d, V = d[d > _ABSORBED**2], V[:, d > _ABSORBED**2]
    root = V / lengths[:, None]
    g = (root / d) @ (V.T @ (X.T @ problem.complement.left))
    return g, (root / d) @ root.T, (V @ V.T) * lengths / lengths[:, None]


def _with_frame(model: Model, frame: int) -> Model:
    """The model with a displacement of a frame along its axes as its last six parameters."""
    names = ("x", "y", "z", "rx", "ry", "rz")
    own = tuple(Parameter("steady", "frame", name, "um", 1e-6, 1e-3) for name in names)
    moved = FrameEffect(where="frame", own=own, frame=frame, directions=np.eye(6))
    return model.with_effects((*model.effects, moved))


def _as_error(moves: Array, moved: Array, seen: Mask) -> Array:
    """Least-squares displacement (m, c) that moves readings so (m, C, r); NaN where too few are seen.

    moves : ndarray, shape (m, C, r, c), how they follow it
    """
    m, c = len(moved), moves.shape[-1]
    D = np.where(seen[..., None, None], moves, 0.0).reshape(m, -1, c)
    rows = np.where(seen[..., None], moved, 0.0).reshape(m, -1, 1)
    told = D.any(axis=-1).sum(axis=1) >= c
    return np.where(told[:, None], (np.linalg.pinv(D) @ rows)[..., 0], np.nan)


def _is_function(variable: Array, error: Array) -> bool:
    """Whether an error (m,) follows from the variable alone: neighbours predict what lies between."""
    distinct, group = np.unique(np.round(variable, 9), return_inverse=True)
    means = np.bincount(group, error) / np.bincount(group)
    within = np.abs(error - means[group])
    between = np.abs(np.interp(distinct[1:-1:2], distinct[::2], means[::2]) - means[1:-1:2])
    scatter = max(float(within.max()), float(np.quantile(between, 0.8)) if len(between) else 0.0)
    return scatter <= _FUNCTION * float(np.ptp(error))


# -- where a place is off, and over what -------------------------------------------------------


def frame_of(where: str, robot: Robot) -> int | None:
    """Number of the frame that is displaced at a place, None where it is no single one."""
    if where in robot.joints:
        return robot.joints.index(where) + 1
    return {"base": 0, "tool": robot.tip_frame}.get(where)


def _displacement(candidate: Candidate, values: Array, frame: int, state: State) -> Array | None:
    """Displacement (m, 6) of a frame by an effect at its values (p,); None where it acts otherwise."""
    effect = candidate.effect
    if not isinstance(effect, TwistEffect):
        return None
    if isinstance(effect, PoseEffect):
        moved = effect.displacements(state.poses, values)
    else:
        moved = displaced(effect.twists(state, values), values)
    own = [np.broadcast_to(xi, (len(state.poses), 6)) for at, xi in moved if at == frame]
    return np.sum(own, axis=0) if own else None


def _directions(where: str, moved: Array | None, frame: int, robot: Robot, state: State) -> Array:
    """Directions in which a place is off, shape (6, c), orthonormal, in the axes of its frame.

    A joint is off along its axis, or across it where it is displaced so (m, 6). The first direction
    across is that about which the moment varies most.
    """
    if where not in robot.joints:
        return np.eye(6)
    axis = along_axis(robot, robot.joints.index(where))
    along = axis[:, None]
    if moved is None or axis[:3].any():
        return along
    beside = moved - moved @ along @ along.T
    if float((beside**2).sum()) <= _BESIDE * float((moved**2).sum()):
        return along
    across = np.eye(3) - np.outer(axis[3:], axis[3:])
    moments = state.wrench.local[:, frame, 3:] @ across
    # A little of the frame's own axes decides where no moment varies.
    _, _, Vt = np.linalg.svd(np.concatenate([moments - moments.mean(axis=0), 1e-9 * across]))
    tilts = np.column_stack([Vt[0], np.cross(axis[3:], Vt[0])])
    return np.concatenate([np.zeros((3, 2)), tilts])


def _load(moved: Array | None, directions: Array, frame: int, state: State) -> Array:
    """Component of the wrench at a frame over which its error is drawn, shape (6,), a unit vector.

    For a joint that along its first direction; for base and tool the one that the displacement follows
    best, or that varies most where no displacement is known.
    """
    if directions.shape[1] < len(directions):
        return directions[:, 0]
    wrench = state.wrench.local[:, frame] - state.wrench.local[:, frame].mean(axis=0)
    size = np.maximum(np.linalg.norm(wrench, axis=0), 1e-12)
    if moved is not None:
        size = np.linalg.norm((wrench / size).T @ (moved * np.repeat([1.0, _ARM], 3)), axis=1)
    return np.asarray(np.eye(6)[int(np.argmax(size))])


def _variable(depends_on: str, load: Array, frame: int, robot: Robot, state: State) -> Array | None:
    """What an error depends on, shape (m,), SI; None where that is no number of a pose.

    load : ndarray, shape (6,), component of the wrench that stands for the load
    """
    if depends_on == "load":
        return np.asarray(state.wrench.local[:, frame] @ load)
    known = pose_variables(robot, state.poses).get(depends_on)
    return None if known is None else known.at(state.poses)
