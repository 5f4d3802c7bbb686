"""Distances between segments, balls and boxes, against MuJoCo, dense sampling, and by hand."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from doe.constraints.distances import (
    point_box,
    point_segment,
    segment_box,
    segment_halfspace,
    segment_segment,
)


class TwoShapes:
    """Two geoms of MuJoCo, moved at will."""

    def __init__(self, first: str, second: str) -> None:
        geoms = "".join(f'<geom type="{kind}" size="1 1 1"/>' for kind in (first, second))
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option ccd_tolerance="1e-12" ccd_iterations="200"/>'
            f"<worldbody>{geoms}</worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)

    def place(self, geom: int, size: Array, position: Array, R: Array) -> None:
        self.model.geom_size[geom] = size
        self.data.geom_xpos[geom] = position
        self.data.geom_xmat[geom] = R.ravel()

    def capsule(self, geom: int, start: Array, end: Array, radius: float) -> None:
        half = np.array([radius, 0.5 * np.linalg.norm(end - start), 0.0])
        self.place(geom, half, 0.5 * (start + end), along_z(end - start))

    def distance(self) -> float:
        return mujoco.mj_geomDistance(self.model, self.data, 0, 1, 100.0, None)


def along_z(direction: Array) -> Array:
    """A rotation whose z axis has this direction."""
    R, _ = Rotation.align_vectors(direction[None], [[0.0, 0.0, 1.0]])
    return R.as_matrix()


def segments(seed: int, count: int) -> tuple[Array, Array]:
    """Segments of all lengths around the origin."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2.0, 2.0, (count, 3))
    return start, start + rng.normal(size=(count, 3)) * rng.uniform(0.01, 2.0, (count, 1))


def test_segments_against_mujoco() -> None:
    a, b = segments(1, 300)
    c, d = segments(2, 300)
    oracle, expected = TwoShapes("capsule", "capsule"), []
    for ends in zip(a, b, c, d, strict=True):
        oracle.capsule(0, ends[0], ends[1], 0.01)
        oracle.capsule(1, ends[2], ends[3], 0.01)
        expected.append(oracle.distance() + 0.02)
    np.testing.assert_allclose(segment_segment(a, b, c, d), expected, atol=1e-7)


def sampled(a: Array, b: Array, count: int = 4001) -> Array:
    """Points along segments, shape (count, n, 3)."""
    return a + np.linspace(0.0, 1.0, count)[:, None, None] * (b - a)


def test_halfspace_and_points_against_dense_sampling() -> None:
    """The least over samples is never below the distance, and above it by less than half a step."""
    a, b = segments(6, 200)
    point, normal = np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 0.5])
    step = np.linalg.norm(b - a, axis=1) / 4000
    x = sampled(a, b)
    height = (x - point) @ normal / np.linalg.norm(normal)
    cases = [
        (segment_halfspace(a, b, point, normal), np.maximum(-height, 0.0)),
        (point_segment(point, a, b), np.linalg.norm(x - point, axis=-1)),
    ]
    for exact, along in cases:
        nearest = along.min(axis=0)
        assert (exact <= nearest + 1e-12).all()
        assert (nearest - exact <= 0.5 * step + 1e-12).all()
        assert (exact > 0.01).sum() > 20


def test_box_is_exact() -> None:
    """The nearest point of a segment, found by halving the interval where the slope changes sign."""
    a, b = segments(8, 500)
    half = np.array([0.3, 0.7, 0.5])

    def outside(t: Array) -> Array:
        x = a + t[:, None] * (b - a)
        return x - np.clip(x, -half, half)

    low, high = np.zeros(500), np.ones(500)
    for _ in range(80):
        middle = 0.5 * (low + high)
        rises = np.einsum("ni,ni->n", outside(middle), b - a) > 0.0
        low, high = np.where(rises, low, middle), np.where(rises, middle, high)
    expected = np.linalg.norm(outside(high), axis=1)
    np.testing.assert_allclose(segment_box(a, b, half), expected, atol=1e-12)


def test_point_box_by_hand() -> None:
    half = np.array([1.0, 2.0, 3.0])
    points = np.array([[0.5, -1.0, 2.9], [1.5, 0.0, 0.0], [4.0, 6.0, 0.0], [-3.0, -4.0, 4.0]])
    np.testing.assert_allclose(point_box(points, half), [0.0, 0.5, 5.0, 3.0], atol=1e-15)


def test_degenerate_segments() -> None:
    """Points, parallel, collinear and crossing segments, in either order."""
    o, x, y, z = np.zeros(3), *np.eye(3)
    cases = [
        (o, o, x, x, 1.0),  # two points
        (o, x, 0.5 * x + y, 0.5 * x + y, 1.0),  # a point beside a segment
        (o, 2 * x, x + y, 4 * x + y, 1.0),  # parallel, side by side in part
        (o, x, 4 * x + 4 * y, 8 * x + 4 * y, 5.0),  # parallel, one after the other
        (o, x, 8 * x + 4 * y, 4 * x + 4 * y, 5.0),  # the same, opposite directions
        (o, x, 3 * x, 5 * x, 2.0),  # in line
        (o, 2 * x, x, 5 * x, 0.0),  # in line, overlapping
        (-x, x, -y + 0.25 * z, y + 0.25 * z, 0.25),  # crossing
        (o, x, o, x, 0.0),
    ]
    a, b, c, d, expected = (np.array(column) for column in zip(*cases, strict=True))
    np.testing.assert_allclose(segment_segment(a, b, c, d), expected, atol=1e-12)
    np.testing.assert_allclose(segment_segment(c, d, a, b), expected, atol=1e-12)
    np.testing.assert_allclose(segment_segment(b, a, c, d), expected, atol=1e-12)
    half = np.array([0.5, 0.5, 0.5])
    np.testing.assert_allclose(segment_box(3 * x, 3 * x, half), 2.5, atol=1e-15)
    np.testing.assert_allclose(segment_box(x - 9 * y, x + 9 * y, half), 0.5, atol=1e-15)
    np.testing.assert_allclose(segment_box(-9 * y, 9 * y, half), 0.0, atol=1e-15)


def test_nearly_parallel_segments() -> None:
    """At every angle, however small, the distance is right to the square root of rounding."""
    for angle in 10.0 ** -np.arange(1.0, 17.0):
        a, b = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
        c = np.array([-1.0, -angle, 1e-3])
        d = np.array([1.0, angle, 1e-3])
        assert segment_segment(a, b, c, d) == pytest.approx(1e-3, abs=1e-9)
