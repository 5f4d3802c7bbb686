"""A second instrument beside a tracker: its readings identify as its noise says.

The truth is plain numpy: a chain, an anchor and distances that share no code with the estimator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.cell import Repeatability
from calib.effects.protocol import Effect
from calib.files.write_tables import measurements_csv
from calib.instruments import Distance, Instrument, Tracker
from calib.model.build import build
from calib.model.covariance import errors_at
from calib.noise import Noise
from calib.poses import poses_at
from tests.helpers import cell_of, random_robot
from tests.plain_arm import rotation, tips

MARKERS = np.array([[0.10, 0.02, -0.05], [-0.04, 0.12, 0.03]])
OFFSETS = ("j2", "j3", "j4")
OFF = f"joint_offset:{','.join(OFFSETS)}"
BAR, SIGMA, LASER = 2e-5, 5e-6, Tracker(name="laser", noise=Noise.isotropic(3e-5))
ANCHOR = np.array([0.9, -1.4, 0.6])
TRUE = np.array([4e-4, -7e-4, 5e-4])  # rad, of the joints of OFFSETS


def arm() -> Robot:
    return random_robot(np.random.default_rng(11), 4)


def points_of(robot: Robot, q: Array, off: Array, markers: Array = MARKERS) -> Array:
    """Markers in base axes (m, M, 3), the joints of OFFSETS off by so much."""
    error = np.zeros(robot.dof)
    error[[robot.joints.index(j) for j in OFFSETS]] = off
    T = tips(robot, q + error)
    return np.asarray(markers @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])


def distances(theta: Array, q: Array, markers: Array = MARKERS) -> Array:
    """Distances (m, M) by offsets and anchor."""
    away = points_of(arm(), q, theta[:3], markers) - theta[3:6]
    return np.asarray(np.sqrt((away**2).sum(axis=-1)))


def slopes(function: Callable[[Array], Array], theta: Array) -> Array:
    """Derivatives (N, p) by central differences."""
    steps = 1e-6 * np.eye(len(theta))
    return np.column_stack(
        [(function(theta + h) - function(theta - h)).ravel() / 2e-6 for h in steps]
    )


def cell_with(*instruments: Instrument, effects: Sequence[str] = ("base", OFF)) -> Cell:
    cell = cell_of(arm(), MARKERS, effects)
    return replace(cell, instruments=instruments, repeatability=Repeatability(0.0, 0.0))


def measured(q: Array, readings: Array, seen: Array | None = None) -> Measurements:
    shape = readings.shape[:2]
    seen = np.ones(shape, dtype=bool) if seen is None else seen
    return Measurements(poses_at(q), readings * seen[..., None], seen, np.full(shape, np.nan))


def drawn(count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, 4))


def in_order(result: calib.Identification) -> list[int]:
    """Positions of offsets and anchor among the values."""
    ids = [p.id for p in result.model.parameters]
    wanted = [f"joint_offset:{j}.offset" for j in OFFSETS]
    return [ids.index(i) for i in (*wanted, *(f"base:bar.{c}" for c in "xyz"))]


def test_beside_a_tracker_information_adds() -> None:
    """Half of the poses are read by the tracker, half by the bar, some by both."""
    q, theta = drawn(24, 2), np.concatenate([TRUE, ANCHOR, [0.3, -2.0, 0.8, 0.4, -1.1, 0.7]])
    by_laser, by_bar = np.arange(24) < 14, np.arange(24) >= 10

    def laser(t: Array) -> Array:
        R = rotation(t[9:])
        return points_of(arm(), q[by_laser], t[:3]) @ R.T + t[6:9]

    def bar(t: Array) -> Array:
        return distances(t, q[by_bar])

    J = np.concatenate([slopes(laser, theta) / BAR, slopes(bar, theta) / SIGMA])
    expected = np.linalg.inv(J.T @ J)
    readings, seen = np.zeros((24, 4, 3)), np.zeros((24, 4), dtype=bool)
    seen[by_laser, :2], seen[by_bar, 2:] = True, True
    instruments = (
        Tracker(name="laser", noise=Noise.isotropic(BAR)),
        Distance(name="bar", sigma=SIGMA),
    )
    cell, rng, squared = cell_with(*instruments), np.random.default_rng(3), []
    for _ in range(12):
        points, lengths = laser(theta), bar(theta)
        readings[by_laser, :2] = points + BAR * rng.standard_normal(points.shape)
        readings[by_bar, 2:, 0] = lengths + SIGMA * rng.standard_normal(lengths.shape)
        found = calib.identify(cell, measured(q, readings, seen))
        ids = [p.id for p in found.model.parameters]
        place = [ids.index(f"base:base.{c}") for c in ("x", "y", "z", "rx", "ry", "rz")]
        at = [*in_order(found), *place]
        assert found.dof == 3 * 28 + 28 - 12
        error = found.values[at] - theta
        squared.append(error @ np.linalg.solve(expected, error))
        std = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found.std[at] / found.noise.factor, std, rtol=0.03)
    assert sum(squared) == pytest.approx(144.0, abs=4.0 * np.sqrt(288.0))


def test_through_a_table(tmp_path: Path) -> None:
    """Rows of both, by the column ``instrument``; what does not apply is empty."""
    q = drawn(5, 6)
    cell = cell_with(LASER, Distance(name="bar", markers=(1,)))
    readings, seen = np.zeros((5, 3, 3)), np.ones((5, 3), dtype=bool)
    readings[:, :2] = points_of(arm(), q, TRUE)
    readings[:, 2, 0] = distances(np.concatenate([TRUE, ANCHOR]), q)[:, 1]
    seen[3, 0] = seen[1, 2] = False
    data = measured(q, readings, seen)
    text = measurements_csv(cell, data)
    assert text.splitlines()[0].endswith("x_mm,y_mm,z_mm,d_mm")
    (tmp_path / "m.csv").write_text(text)
    back = calib.load_measurements(cell, tmp_path / "m.csv")
    np.testing.assert_array_equal(back.seen, seen)
    np.testing.assert_allclose(back.readings, data.readings, atol=6e-9)
    for old, new, said in (
        (",bar,", ",rod,", "'rod' is not in the cell; instruments are laser, bar"),
        ("m2,bar,", "m1,bar,", "is nothing that instrument 'bar' reads"),
    ):
        (tmp_path / "bad.csv").write_text(text.replace(old, new, 1))
        with pytest.raises(calib.CalibError, match=said):
            calib.load_measurements(cell, tmp_path / "bad.csv")


def test_accuracy_at_targets_counts_points() -> None:
    """Whatever reads, the error expected of a target is that of its points."""
    cell = cell_with(Distance(name="bar"))
    targets = poses_at(drawn(3, 9))
    model = build(cell, targets).model
    at = model.where(Effect)
    own = [i for i in at if model.parameters[i].effect == "joint_offset"]
    cov = np.zeros((len(at), len(at)))
    cov[own, own] = 1e-8
    errors = errors_at(model, model.initial, cov, targets)
    moved = slopes(lambda t: points_of(arm(), targets.q, t, np.zeros((1, 3))), np.zeros(3))
    expected = 1e-4 * np.sqrt((moved.reshape(3, -1) ** 2).sum(axis=1))
    np.testing.assert_allclose(errors, expected, rtol=1e-6)
