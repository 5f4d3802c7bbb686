"""Residuals and their derivatives under the paper's two approaches, weighted by the noise.

``points`` (approach #2) compares marker coordinates. ``pose`` (approach #1) first condenses the markers
of a reading to position and orientation of the tip frame: with ``A_j = [I, -[X_j - o]x]`` the
least-squares pose change of marker changes y is ``(A^T A)^-1 A^T y``. Weighted by its full propagated
covariance this loses nothing while the markers move rigidly, so for a known marker geometry both
approaches have the same information; weighted plainly, with one length for the rotations, it does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from calib.effects.tool import Tool
from calib.model import Model
from calib.poses import Measurements
from calib.se3 import Array, fit_rigid, rotate, skew, so3_exp, so3_log, transform

Approach = Literal["points", "pose"]
Weighting = Literal["full", "plain"]

_COLLINEAR = 1e-3  # ratio of marker spreads below which no orientation can be computed


@dataclass(frozen=True, eq=False)
class Observation(ABC):
    """How readings become weighted residuals.

    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices, zero for what does not count
    """

    model: Model
    data: Measurements
    weights: Array

    @abstractmethod
    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., m, rows), in standard deviations, and the derivative of the prediction."""

    def span(self) -> Array:
        """Directions in which values may move, shape (p, k)."""
        return np.eye(len(self.model.parameters))

    def row_noise(self) -> Array | None:
        """Covariance of the weighted rows (m, rows, rows), None where it is the identity."""
        return None

    def only(self, kept: NDArray[np.bool_]) -> Self:
        """The observation with the other poses weighted out."""
        return replace(self, weights=self.weights * kept[:, None, None, None])

    def points(self, centred: bool = False) -> Points:
        """The marker points behind it: what poses and noise are judged by."""
        return Points(self.model, self.data, self.weights, centred)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Markers that count, shape (m, M)."""
        return np.asarray(self.data.seen & self.weights.any(axis=(-1, -2)))


@dataclass(frozen=True, eq=False)
class Points(Observation):
    """Approach #2: every coordinate of every marker.

    centred : subtract the mean of each configuration: only differences between readings at equal
        joints count, what is common to them (geometry) drops out
    """

    centred: bool = False

    def linearise(self, values: Array) -> tuple[Array, Array]:
        predicted, J = self.model.jacobian(values, self.data.poses)
        return self.residuals(predicted), self.rows(J)

    def residuals(self, predicted: Array) -> Array:
        """Weighted residuals, shape (..., m, 3 M)."""
        r = self._relative((self.data.points - predicted)[..., None])
        return (self.weights @ r).reshape((*r.shape[:-3], -1))

    def rows(self, J: Array) -> Array:
        """Weighted rows of a Jacobian (..., m, M, 3, p), shape (..., m, 3 M, p)."""
        weighted = self.weights @ self._relative(J)
        return weighted.reshape((*J.shape[:-3], -1, J.shape[-1]))

    def _relative(self, a: Array) -> Array:
        """Subtract the weighted mean of each configuration: what its readings have in common."""
        if not self.centred:
            return a
        out = np.empty_like(a)
        group = self.data.poses.configuration
        information = np.swapaxes(self.weights, -1, -2) @ self.weights
        for g in np.unique(group):
            here = group == g
            own, total = information[here], information[here].sum(axis=0)
            hidden = np.logical_not(total.any(axis=(-1, -2), keepdims=True))
            weighted = (own @ a[..., here, :, :, :]).sum(axis=-4)
            mean = np.linalg.solve(total + hidden * np.eye(3), weighted)
            out[..., here, :, :, :] = a[..., here, :, :, :] - mean[..., None, :, :, :]
        return out


@dataclass(frozen=True, eq=False)
class Pose(Observation):
    """Approach #1: position and orientation of the tip frame, computed from the markers.

    shape : ndarray, shape (M, 3), m, markers in the tip frame as known when the poses are computed;
        an error of it shifts every pose alike and is taken up by the tool
    weighting : "full" for the propagated covariance, "plain" for one standard deviation of position
        and the same over ``length`` [m] for orientation
    """

    shape: Array
    weighting: Weighting = "full"
    length: float = 1.0

    def linearise(self, values: Array) -> tuple[Array, Array]:
        predicted, J = self.model.jacobian(values, self.data.poses)
        T = fit_rigid(predicted, self.shape, self._fitted)
        measured, L = self.computed
        turn = measured[:, :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
        residual = np.concatenate([measured[:, :3, 3] - T[..., :3, 3], so3_log(turn)], axis=-1)
        residual = np.where(self.usable[:, None], residual, 0.0)
        flat = J.reshape((*J.shape[:-3], -1, J.shape[-1]))
        return rotate(self.scale, residual), (self.scale @ L) @ flat

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Poses whose visible markers fix an orientation, shape (m,)."""
        return orientable(self.shape, self.counted)

    @cached_property
    def _fitted(self) -> Array:
        """One for markers that enter a pose, shape (m, M); for all where the pose is not used."""
        return (self.data.seen | ~self.usable[:, None]).astype(float)

    @cached_property
    def computed(self) -> tuple[Array, Array]:
        """Tip frame in station axes as computed from the markers, and how it follows them.

        Shapes (m, 4, 4) and (m, 6, 3 M), the latter zero where no pose can be computed. With the
        full weighting the fit of the pose is itself weighted by the noise of the points.
        """
        T = fit_rigid(self.data.points, self.shape, self._fitted)
        marked = rotate(T[:, None, :3, :3], self.shape) + T[:, None, :3, 3]
        used = self.data.seen & self.usable[:, None]
        weights = self.weights if self.weighting == "full" else None
        L = pose_from_points(marked, T[:, :3, 3], used, weights)
        rest = ((self.data.points - marked) * used[..., None]).reshape(len(T), -1)
        step = rotate(L, rest)
        R = so3_exp(step[:, 3:]) @ T[:, :3, :3]
        return transform(R, T[:, :3, 3] + step[:, :3]), L

    @cached_property
    def propagated(self) -> Array:
        """Covariance of the computed poses, shape (m, 6, 6), m and rad; identity if not usable."""
        half = self.computed[1] @ blockwise_inverse(self.weights)
        return half @ np.swapaxes(half, -1, -2) + ~self.usable[:, None, None] * np.eye(6)

    @cached_property
    def scale(self) -> Array:
        """Weight of each pose, shape (m, 6, 6)."""
        if self.weighting == "full":
            return np.linalg.inv(np.linalg.cholesky(self.propagated))
        used = self.weights[self.data.seen & self.usable[:, None]]
        sigma = np.sqrt((np.linalg.inv(used) ** 2).sum(axis=-1).mean())
        diagonal = np.diag([1.0] * 3 + [self.length] * 3) / sigma
        return np.broadcast_to(diagonal, (len(self.data), 6, 6))

    def row_noise(self) -> Array | None:
        """Covariance (m, 6, 6) of the weighted rows where it is not the identity."""
        if self.weighting == "full":
            return None
        return self.scale @ self.propagated @ np.swapaxes(self.scale, -1, -2)

    def span(self) -> Array:
        """The set of markers moves as one rigid body: its shape is no unknown."""
        N = np.eye(len(self.model.parameters))
        tools = self.model.where(Tool)
        if not len(tools):
            return N
        motions = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(self.shape), 3, 3)), -skew(self.shape)], -1
        )
        free = np.zeros(self.shape.shape, dtype=bool)
        for effect in self.model.effects:
            if isinstance(effect, Tool):
                free[effect.marker, list(effect.components)] = True
        # Components that the reduction dropped stay still: only motions that leave them so.
        _, singular, Vt = np.linalg.svd(np.vstack([motions[~free], np.zeros((6, 6))]))
        allowed = Vt[singular < 1e-9].T
        rigid = np.zeros((len(N), allowed.shape[1]))
        rigid[tools] = motions[free] @ allowed
        others = np.setdiff1d(np.arange(len(N)), tools)
        return np.column_stack([N[:, others], rigid])


def orientable(markers: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the visible markers of a pose span a plane, shape (m,)."""
    weight = seen.astype(float)[..., None]
    mean = (weight * markers).sum(axis=1, keepdims=True) / np.maximum(
        weight.sum(1, keepdims=True), 1
    )
    spread = np.linalg.svd((markers - mean) * weight, compute_uv=False)
    if spread.shape[-1] < 2:
        return np.zeros(len(seen), dtype=bool)
    return np.asarray((seen.sum(axis=1) >= 3) & (spread[:, 1] > _COLLINEAR * spread[:, 0]))


def pose_from_points(
    points: Array, origin: Array, seen: NDArray[np.bool_], weights: Array | None = None
) -> Array:
    """Least-squares pose change for changes of the points, shape (..., m, 6, 3 M).

    points : ndarray, shape (..., m, M, 3), m; origin : ndarray, shape (..., m, 3), m
    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices; equal weights without
    Rows: translation of the origin [m/m], then rotation vector [rad/m], in the axes of the points.
    """
    arms = -skew(points - origin[..., None, :])
    A = np.concatenate([np.broadcast_to(np.eye(3), arms.shape), arms], axis=-1)
    counted = A * seen[..., None, None]
    if weights is not None:
        counted = np.swapaxes(weights, -1, -2) @ (weights @ counted)
    weighted = np.swapaxes(counted.reshape((*A.shape[:-3], -1, 6)), -1, -2)
    idle = np.logical_not(seen.any(axis=-1, keepdims=True))[..., None] * np.eye(6)
    return np.asarray(
        np.linalg.solve(weighted @ A.reshape((*A.shape[:-3], -1, 6)) + idle, weighted)
    )


def blockwise_inverse(weights: Array) -> Array:
    """Block-diagonal square root of the points' covariance, shape (m, 3 M, 3 M), m."""
    m, M = weights.shape[:2]
    hidden = np.logical_not(weights.any(axis=(-1, -2), keepdims=True))
    blocks = np.where(hidden, 0.0, np.linalg.inv(weights + hidden * np.eye(3)))
    out = np.zeros((m, 3 * M, 3 * M))
    for j in range(M):
        out[:, 3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = blocks[:, j]
    return out
