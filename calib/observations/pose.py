"""Approach #1 of the paper: position and orientation of the tip, computed from the markers first.

With ``A_j = [I, -[X_j - o]x]`` the least-squares pose change of marker changes y is
``(A^T A)^-1 A^T y``. Weighted by its full propagated covariance this loses nothing while the markers
move rigidly, so for a known marker geometry both approaches have the same information; weighted
otherwise it does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calib.arm.se3 import fit_rigid, rotate, so3_exp, so3_log, transform, transformed
from calib.arrays import Array, Mask
from calib.effects.tool_base import Tool
from calib.observations.linear import LinearProblem
from calib.observations.points import Observation, Points, points_of
from calib.observations.shape import (
    free_components,
    kept_in_place,
    orientable,
    pose_from_points,
    rigid_motions,
    shape_response,
)
from calib.result import fields_of

Weighting = Literal["full", "normalised", "plain"]


@dataclass(frozen=True, eq=False)
class PoseObservation(Observation):
    """Position [m] and rotation vector [rad] of the tip frame at each reading.

    shape : ndarray, shape (..., M, 3), m, markers in the tip frame as known when the poses are
        computed
    weighting : "full" for the inverse of the propagated covariance, "normalised" for each component
        over its own standard deviation, "plain" for one standard deviation of position and the same
        over ``length`` [m] for orientation
    own_shape : the shape was computed from these same readings; its error shifts every pose that
        shows the same markers alike, which the tool takes up, and others differently
    """

    shape: Array
    weighting: Weighting = "full"
    length: float = 1.0
    own_shape: bool = False

    @property
    def efficient(self) -> bool:
        return self.weighting == "full"

    def whitened(self, values: Array) -> tuple[Array, Array]:
        predicted, J = self.model.jacobian(values, self.data.poses)
        T = fit_rigid(predicted, self.shape[..., None, :, :], self._fitted)
        measured, _ = self.computed
        turn = measured[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
        residual = np.concatenate([measured[..., :3, 3] - T[..., :3, 3], so3_log(turn)], axis=-1)
        residual = np.where(self.usable[:, None], residual, 0.0)
        return rotate(self.scale, residual), self.rows(J)

    def rows(self, J: Array) -> Array:
        flat = J.reshape((*J.shape[:-3], -1, J.shape[-1]))
        return np.asarray((self.scale @ self.computed[1]) @ flat)

    @cached_property
    def usable(self) -> Mask:
        """Poses whose visible markers fix an orientation, shape (m,)."""
        return orientable(self.shape.reshape(-1, *self.shape.shape[-2:])[0], self.counted)

    @cached_property
    def _fitted(self) -> Array:
        """One for markers that enter a pose, shape (m, M); for all where the pose is not used."""
        return (self.data.seen | ~self.usable[:, None]).astype(float)

    @cached_property
    def computed(self) -> tuple[Array, Array]:
        """Tip frame in station axes as computed from the markers, and how it follows them.

        Shapes (..., m, 4, 4) and (..., m, 6, 3 M), the latter zero where no pose can be computed.
        With the full weighting the fit of the pose is itself weighted by the noise of the points.
        """
        beside = self.shape[..., None, :, :]
        T = fit_rigid(self.data.points, beside, self._fitted)
        marked = transformed(T[..., None, :, :], beside)
        used = self.data.seen & self.usable[:, None]
        weights = self.weights if self.weighting == "full" else None
        L = pose_from_points(marked, T[..., :3, 3], used, weights)
        rest = ((self.data.points - marked) * used[..., None]).reshape((*T.shape[:-2], -1))
        step = rotate(L, rest)
        R = so3_exp(step[..., 3:]) @ T[..., :3, :3]
        return transform(R, T[..., :3, 3] + step[..., :3]), L

    @cached_property
    def propagated(self) -> Array:
        """Covariance of the computed poses, (..., m, 6, 6), m and rad; identity if not usable."""
        half = self.computed[1] @ blockwise_inverse(self.weights)
        return half @ np.swapaxes(half, -1, -2) + ~self.usable[:, None, None] * np.eye(6)

    @cached_property
    def scale(self) -> Array:
        """Weight of each pose, shape (..., m, 6, 6)."""
        if self.weighting == "full":
            return np.linalg.inv(np.linalg.cholesky(self.propagated))
        if self.weighting == "normalised":
            own = np.sqrt(np.diagonal(self.propagated, axis1=-2, axis2=-1) + self._approached)
            return np.eye(6) / own[..., None, :]
        used = self.weights[self.data.seen & self.usable[:, None]]
        sigma = np.sqrt((np.linalg.inv(used) ** 2).sum(axis=-1).mean())
        diagonal = np.diag([1.0] * 3 + [self.length] * 3) / sigma
        return np.broadcast_to(diagonal, (len(self.data), 6, 6))

    @property
    def _approached(self) -> Array:
        """What the arm's known repeatability adds to each component, (..., m, 6), m^2 and rad^2."""
        known = self.known
        if known is None or not known.variances.any:
            return np.zeros(6)
        levers = self.computed[1] @ known.levers.reshape(len(self.data), -1, known.joints + 6)
        return np.asarray((levers**2 * known.variances.approach[known.kinds]).sum(axis=-1))

    def covariance(self, values: Array, span: Array) -> Array:
        """Covariance (p, p), from the noise of the points through shape, poses and fit.

        What is known beside them is as uncertain as the noise of the points makes it: see
        :attr:`prior_weight`.
        """
        if self.efficient and not self.own_shape:
            return super().covariance(values, span)
        linear, of_points = self.linear(values, span), points_of(self).mixing
        half, held = self._response(linear) @ blockwise_inverse(self.weights), linear.held_gains
        if of_points is not None:
            gains = np.swapaxes(half, -1, -2).reshape(*self.weights.shape[:3], -1)
            at = np.arange(len(gains))[:, None], self.data.read
            rows = gains[at].reshape(len(gains), -1, gains.shape[-1])
            return of_points.covariance(rows) + held.T @ held
        of_held = held.T @ held / self.prior_weight**2  # as stated: the residual widens all alike
        return np.asarray(np.einsum("mpa,mqa->pq", half, half, optimize=True) + of_held)

    def _response(self, linear: LinearProblem) -> Array:
        """How values follow the points, through shape, poses and fit, shape (m, p, 3 M)."""
        T, L = self.computed
        fit = np.swapaxes(linear.gains, -1, -2)
        m, p = fit.shape[:2]
        response = fit @ self.scale @ L
        if self.own_shape:
            own = shape_response(T, self.shape, self.data.seen & self.usable[:, None])
            own = kept_in_place(self.shape, free_components(self.model)) @ own
            turned = response.reshape(m, p, -1, 3) @ T[:, None, :3, :3]
            shifted = turned.reshape(m, p, -1).sum(axis=0)
            followed = self.model.marker_columns.reshape(-1, p).T  # by markers of their own
            response = response + (followed - shifted) @ own
        return np.asarray(response)

    def span(self) -> Array:
        """The set of markers moves as one rigid body: its shape is no unknown."""
        tools = self.model.where(Tool)
        if not len(tools):
            return super().span()
        N = np.eye(len(self.model.parameters))
        shape = self.shape.reshape(-1, *self.shape.shape[-2:])[0]
        motions = rigid_motions(shape).reshape(*shape.shape, 6)
        free = free_components(self.model)
        # Components that the reduction dropped stay still: only motions that leave them so.
        _, singular, Vt = np.linalg.svd(np.vstack([motions[~free], np.zeros((6, 6))]))
        allowed = Vt[singular < 1e-9].T
        rigid = np.zeros((len(N), allowed.shape[1]))
        rigid[tools] = motions[free] @ allowed
        others = np.setdiff1d(np.arange(len(N)), [*tools, *self.model.still])
        return np.column_stack([N[:, others], rigid])


def as_poses(
    points: Points, shape: Array, weighting: Weighting = "full", length: float = 1.0
) -> PoseObservation:
    """Poses computed from the markers; readings that show too few of them are left out.

    shape : ndarray, shape (..., M, 3), m; it counts as computed from these readings where the tool is
        in the model, as known otherwise
    """
    own = bool(len(points.model.where(Tool)))
    pose = PoseObservation(**fields_of(points), shape=shape, weighting=weighting, length=length)
    return replace(pose.only(pose.usable), own_shape=own)


def blockwise_inverse(weights: Array) -> Array:
    """Block-diagonal square root of the points' covariance, shape (m, 3 M, 3 M), m."""
    m, M = weights.shape[:2]
    hidden = np.logical_not(weights.any(axis=(-1, -2), keepdims=True))
    blocks = np.where(hidden, 0.0, np.linalg.inv(weights + hidden * np.eye(3)))
    out = np.zeros((m, 3 * M, 3 * M))
    for j in range(M):
        out[:, 3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = blocks[:, j]
    return out
