"""Rotations and rigid motions, batched over leading axes.

Conventions, fixed here for the whole project:

- ``R_a_b`` and ``p_a_b`` take a point from frame b to frame a: ``p_a = R_a_b p_b + p_a_b``.
- A small displacement has six components ``(x, y, z, rx, ry, rz)``: a translation in metres,
  then a rotation vector in radians, both in the axes of the frame where it acts.
- Displacements act on the right, ``T D`` with ``D = [exp(r) | t]``: first order a twist, and
  exactly what the ``origin`` of a URDF joint can hold.

What is made here of components lies in memory component after component, whatever its shape: numpy's
inner loops then run over the batch, not over three numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from calib.arrays import Array, batch_first, room

_SMALL_ANGLE = 1e-4  # below it the series of the logarithm is exact to rounding
_SERIES, _TERMS = 0.01, 4  # rad^2, squared angles up to which terms beyond these are below rounding


def skew(v: Array) -> Array:
    """Matrix of the cross product, ``skew(v) @ w == cross(v, w)`` (paper, equation 10).

    v : ndarray, shape (..., 3) -> ndarray, shape (..., 3, 3)
    """
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = np.zeros_like(x)
    return _matrix([zero, -z, y, z, zero, -x, -y, x, zero])


def _matrix(entries: Sequence[Array]) -> Array:
    """Matrices (..., 3, 3) of nine entries (...), row by row."""
    rows = np.array(entries)  # half the time of stack
    return batch_first(rows.reshape((3, 3, *rows.shape[1:])), 2)


def cross(a: Array, b: Array) -> Array:
    """Cross product, shape (..., 3), of a and b, with broadcasting.

    Several times faster than numpy's.
    """
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return batch_first(np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]), 1)


def across(axis: Array) -> Array:
    """Two unit vectors across a unit vector of shape (3,) and across each other, shape (2, 3).

    The first is the coordinate axis that lies most across, less its part along ``axis``.
    """
    chosen = np.eye(3)[int(np.abs(axis).argmin())]
    u = chosen - axis * (axis @ chosen)
    u = u / np.linalg.norm(u)
    return np.stack([u, cross(axis, u)])


def rotate(R: Array, v: Array) -> Array:
    """Apply rotations to vectors: shapes (..., 3, 3) and (..., 3), broadcast."""
    out: Array = np.einsum("...ij,...j->...i", R, v)  # half the time of matmul
    return out


def turned(A: Array, B: Array) -> Array:
    """Product of two stacks of matrices (..., 3, 3) and (..., 3, n), broadcast.

    Faster than matmul where components lie together.
    """
    batch = np.broadcast_shapes(A.shape[:-2], B.shape[:-2])
    out = room(batch, 3, B.shape[-1])
    return np.asarray(np.einsum("...ij,...jk->...ik", A, B, out=out))


def by_one(A: Array, M: Array) -> Array:
    """Product of a stack of matrices (..., l, k) and a single one (k, n), shape (..., l, n)."""
    n = A.ndim - 2
    first = A.transpose(n + 1, n, *range(n))
    found = (M.T @ first.reshape(len(M), -1)).reshape((M.shape[1], *first.shape[1:]))
    return found.transpose(*range(2, n + 2), 1, 0)


def double_cross(a: Array, b: Array) -> Array:
    """Matrix of ``w -> a x (b x w)``, that is ``b a^T - (a b) I``, shape (..., 3, 3)."""
    inner = np.einsum("...i,...i->...", a, b)
    products = [b[..., i] * a[..., j] for i in range(3) for j in range(3)]
    for diagonal in products[::4]:
        diagonal -= inner
    return _matrix(products)


def _term(square: Array, first: int) -> Array:
    """sin(a)/a, (1 - cos a)/a^2 or (a - sin a)/a^3 of squared angles, as ``first`` is 1, 2 or 3.

    ``sum_k (-square)^k / (2 k + first)!``, the exact form for large angles.
    """
    large = square > _SERIES
    small = np.full_like(square, 1.0 / math.factorial(2 * _TERMS + first))
    for k in reversed(range(_TERMS)):
        small = 1.0 / math.factorial(2 * k + first) - square * small
    if not large.any():
        return small
    return np.where(large, _EXACT[first](np.sqrt(np.where(large, square, 1.0))), small)


_EXACT: dict[int, Callable[[Array], Array]] = {
    1: lambda a: np.sin(a) / a,
    2: lambda a: 2.0 * (np.sin(a / 2.0) / a) ** 2,
    3: lambda a: (a - np.sin(a)) / a**3,
}


def so3_exp(r: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues).

    r : ndarray, shape (..., 3), rad -> ndarray, shape (..., 3, 3)
    """
    square = _squared(r)
    return _about(r, square, _term(square, 1), _term(square, 2))


def so3_terms(axes: Array) -> Array:
    """What 1, sin and cos of an angle add to the rotation about unit axes (..., 3), (..., 9, 3)."""
    along = axes[..., :, None] * axes[..., None, :]
    parts = np.stack([along, skew(axes), np.eye(3) - along], axis=-1)
    return parts.reshape(*axes.shape[:-1], 9, 3)


def so3_about(terms: Array, angle: Array) -> Array:
    """Rotation matrices, shape (m, 3, 3), by angles (m,), rad, about the axis of some terms (9, 3).

    terms : of :func:`so3_terms`
    """
    functions = np.array([np.ones_like(angle), np.sin(angle), np.cos(angle)])
    return batch_first((terms @ functions).reshape(3, 3, -1), 2)


def _squared(r: Array) -> Array:
    """Squared lengths (...) of vectors (..., 3)."""
    return np.asarray(r[..., 0] ** 2 + r[..., 1] ** 2 + r[..., 2] ** 2)


def _about(r: Array, square: Array, s: Array, c: Array) -> Array:
    """``(1 - c |r|^2) I + s [r]x + c r r^T``, shape (..., 3, 3), of r (..., 3) and scalars (...)."""
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    sx, sy, sz, cx, cy = s * x, s * y, s * z, c * x, c * y
    xy, xz, yz, one = cx * y, cx * z, cy * z, 1.0 - c * square
    xx, yy, zz = one + cx * x, one + cy * y, one + c * z * z
    return _matrix([xx, xy - sz, xz + sy, xy + sz, yy, yz - sx, xz - sy, yz + sx, zz])


def so3_log(R: Array) -> Array:
    """Rotation vector of a rotation matrix, angle in [0, pi].

    R : ndarray, shape (..., 3, 3) -> ndarray, shape (..., 3), rad

    Through the unit quaternion of the largest component, so it is accurate near zero and pi.
    """
    R = np.asarray(R, dtype=float)
    trace = np.trace(R, axis1=-2, axis2=-1)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    # Rows of the symmetric 4x4 matrix 4 q q^T, q = (w, x, y, z); its largest row is q up to scale.
    Q = np.empty((*R.shape[:-2], 4, 4))
    Q[..., 0, 0] = 1.0 + trace
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        Q[..., i + 1, i + 1] = 1.0 + 2.0 * diagonal[..., i] - trace
        Q[..., 0, i + 1] = Q[..., i + 1, 0] = R[..., k, j] - R[..., j, k]
        Q[..., j + 1, k + 1] = Q[..., k + 1, j + 1] = R[..., j, k] + R[..., k, j]
    best = np.argmax(np.diagonal(Q, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(Q, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    scale = np.where(sine < _SMALL_ANGLE, 2.0 + sine**2 / 3.0, angle / np.where(sine == 0, 1, sine))
    out: Array = scale[..., None] * q[..., 1:]
    return out


def so3_right_jacobian(r: Array) -> Array:
    """J with ``exp(r + dr) = exp(r) exp(J dr)`` to first order.

    r : ndarray, shape (..., 3), rad -> ndarray, shape (..., 3, 3)
    """
    square = _squared(r)
    return _about(r, square, -_term(square, 2), _term(square, 3))


def so3_exp_with_jacobian(r: Array) -> tuple[Array, Array]:
    """``so3_exp`` and ``so3_right_jacobian`` at once, each of shape (..., 3, 3), of r (..., 3), rad."""
    square = _squared(r)
    s, c, d = (_term(square, first) for first in (1, 2, 3))
    return _about(r, square, s, c), _about(r, square, -c, d)


def transform(R: Array, p: Array) -> Array:
    """Homogeneous matrix of a rotation and a translation, shape (..., 4, 4)."""
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse(T: Array) -> Array:
    """Inverse of homogeneous rigid transforms, shape (..., 4, 4)."""
    R_inverse = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_inverse, -rotate(R_inverse, T[..., :3, 3]))


def transformed(T: Array, points: Array) -> Array:
    """Points (..., 3) seen from where transforms (..., 4, 4) lead, broadcast."""
    return rotate(T[..., :3, :3], points) + T[..., :3, 3]


def displacement(xi: Array) -> Array:
    """``D(xi) = [exp(rx, ry, rz) | x, y, z]``, shape (..., 6) -> (..., 4, 4)."""
    return transform(so3_exp(xi[..., 3:]), xi[..., :3])


def moved_as_one(xi: Array, points: Array) -> tuple[Array, Array, Array]:
    """Points (..., m, M, 3), m, displaced by a twist xi (..., m, 6), m and rad, of each pose.

    Returns them, the rotations (..., m, 1, 3, 3), and derivatives by the twist (..., m, M, 3, 6).
    """
    xi = xi[..., None, :]  # one for all markers of a pose
    R, J = so3_exp_with_jacobian(xi[..., 3:])
    turn = -R @ skew(points) @ J
    columns = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1)
    return rotate(R, points) + xi[..., :3], R, columns


def displaced_shape(xi: Array, points: Array) -> tuple[Array, Array]:
    """Points (..., M, 3), m, of a shape that grows by a share about its origin and is then displaced.

    xi : ndarray, shape (..., 7), a twist, m and rad, and the share; returns the derivatives by it too
    """
    grown = points * (1.0 + xi[..., None, 6:])
    moved, R, columns = moved_as_one(xi[..., :6], grown)
    by_share = rotate(R, np.broadcast_to(points, grown.shape))[..., None]
    return moved, np.concatenate([columns, by_share], axis=-1)


def from_xyz_rpy(xyz: Array, rpy: Array) -> Array:
    """Transform of a URDF origin: ``R = Rz(yaw) Ry(pitch) Rx(roll)``, metres and radians."""
    roll, pitch, yaw = (so3_exp(axis * angle) for axis, angle in zip(np.eye(3), rpy, strict=True))
    return transform(yaw @ pitch @ roll, np.asarray(xyz, dtype=float))


def rpy_from_rotation(R: Array) -> Array:
    """Roll, pitch, yaw, shape (3,), rad, of a single rotation matrix, shape (3, 3).

    At pitch +-90 degrees yaw is set to zero.
    """
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def fit_rigid(points_a: Array, points_b: Array, weights: Array | None = None) -> Array:
    """Least-squares rigid motion ``T_a_b`` that takes points b onto points a (Kabsch, SVD).

    points_a, points_b : ndarray, shape (..., n, 3), m; weights : ndarray, shape (..., n)
    Returns ndarray, shape (..., 4, 4). Source: Umeyama, IEEE TPAMI 13(4), 1991, without scale.
    """
    w = np.ones(points_a.shape[:-1]) if weights is None else np.asarray(weights, dtype=float)
    w = w / w.sum(axis=-1, keepdims=True)
    mean_a = np.einsum("...n,...ni->...i", w, points_a)
    mean_b = np.einsum("...n,...ni->...i", w, points_b)
    centred_a, centred_b = points_a - mean_a[..., None, :], points_b - mean_b[..., None, :]
    H = np.einsum("...n,...ni,...nj->...ij", w, centred_a, centred_b)
    R = nearest_rotation(H)
    return transform(R, mean_a - rotate(R, mean_b))


def nearest_rotation(M: Array) -> Array:
    """Rotation closest to 3x3 matrices (..., 3, 3) in the Frobenius norm; NaN from NaN."""
    lost = ~np.isfinite(M).all(axis=(-1, -2), keepdims=True)
    U, _, Vt = np.linalg.svd(np.where(lost, np.eye(3), M))
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    U = U.copy()
    U[..., :, 2] *= np.where(sign == 0, 1.0, sign)[..., None]
    return np.where(lost, np.nan, U @ Vt)


def even_directions(count: int) -> Array:
    """Unit vectors spread evenly over the sphere, shape (count, 3): Fibonacci's lattice."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * i
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def steiner(c: Array) -> Array:
    """Inertia of a unit mass at points (..., 3), m, about the origin, (..., 3, 3), m^2."""
    return np.asarray(
        (c**2).sum(axis=-1)[..., None, None] * np.eye(3) - c[..., None] * c[..., None, :]
    )
