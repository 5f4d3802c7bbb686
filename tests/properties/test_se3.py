"""Rotations and rigid motions: the axioms of the group, near zero and near pi."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from calib.arm import se3
from calib.arrays import Array
from tests.helpers import central_difference

vectors = arrays(np.float64, 3, elements=st.floats(-1.8, 1.8))
scales = st.sampled_from([0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1.0])
twists = st.tuples(vectors, vectors, scales).map(
    lambda drawn: np.concatenate([drawn[0], drawn[1] * drawn[2]])
)


@given(twists)
def test_displacement_logarithm_inverse_and_fit(xi: Array) -> None:
    T = se3.displacement(xi)
    np.testing.assert_allclose(T[:3, 3], xi[:3], atol=0.0)
    np.testing.assert_allclose(se3.so3_log(T[:3, :3]), xi[3:], atol=1e-12)
    np.testing.assert_allclose(T @ se3.inverse(T), np.eye(4), atol=1e-12)
    points = np.random.default_rng(1).normal(size=(5, 3))
    moved = points @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(se3.fit_rigid(moved, points), T, atol=1e-10)


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_logarithm_near_pi(distance: float) -> None:
    R = se3.so3_exp((np.pi - distance) * np.array([0.6, -0.48, 0.64]))
    np.testing.assert_allclose(se3.so3_exp(se3.so3_log(R)), R, atol=1e-12)


@given(twists)
def test_right_jacobian_is_the_derivative_of_the_exponential(xi: Array) -> None:
    r = xi[3:]
    R = se3.so3_exp(r)
    numeric = central_difference(lambda v: se3.so3_log(R.T @ se3.so3_exp(v)), r, np.full(3, 1e-3))
    np.testing.assert_allclose(se3.so3_right_jacobian(r), numeric, atol=1e-9)


@given(
    vectors, st.one_of(vectors, st.sampled_from([[0.3, a, -0.8] for a in (np.pi / 2, -np.pi / 2)]))
)
def test_roll_pitch_yaw_round_trip(xyz: Array, rpy: Array) -> None:
    T = se3.from_xyz_rpy(xyz, np.asarray(rpy))
    back = se3.from_xyz_rpy(T[:3, 3], se3.rpy_from_rotation(T[:3, :3]))
    np.testing.assert_allclose(back, T, atol=1e-9)


@pytest.mark.parametrize("size", [1e-5, 0.03, 0.06, 1.0])
def test_rotations_agree_with_scipy(size: float) -> None:
    r = size * np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(se3.so3_exp(r), Rotation.from_rotvec(r).as_matrix(), atol=1e-14)
    R = Rotation.random(50, random_state=1)
    np.testing.assert_allclose(se3.so3_log(R.as_matrix()), R.as_rotvec(), atol=1e-12)


@pytest.mark.parametrize("order", ["C", "F"])
def test_products_do_not_depend_on_how_arrays_lie_in_memory(order: str) -> None:
    rng = np.random.default_rng(0)
    A, B = (np.asarray(rng.normal(size=(4, 5, 3, 3)), order=order) for _ in "AB")
    a, b, w = (np.asarray(rng.normal(size=(4, 5, 3)), order=order) for _ in "abw")
    np.testing.assert_allclose(se3.turned(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(se3.turned(A, B[:1, :, :, :2]), A @ B[:1, :, :, :2], atol=1e-14)
    np.testing.assert_allclose(se3.by_one(A, B[0, 0]), A @ B[0, 0], atol=1e-14)
    np.testing.assert_allclose(se3.by_one(A[0, 0], B[0, 0, :, :1]), A[0, 0] @ B[0, 0, :, :1])
    np.testing.assert_allclose(se3.cross(a, b), np.cross(a, b), atol=1e-14)
    twice = np.cross(a, np.cross(b, w))
    np.testing.assert_allclose(se3.rotate(se3.double_cross(a, b), w), twice, atol=1e-13)
