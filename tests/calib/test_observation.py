"""Observation matrices of both approaches, and what the paper's gain consists of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.cell import Load
from calib.errors import CalibError
from calib.model.build import build
from calib.observations import Points, PoseObservation
from calib.poses import Measurements, poses_at
from calib.simulation import drawn_readings
from tests.helpers import cell_of, central_difference, random_poses, random_robot, with_effects


def information(observation: Points | PoseObservation, values: Array) -> Array:
    _, J = observation.linearise(values)
    J = J.reshape(-1, J.shape[-1])
    return J.T @ J


def both(seed: int, dof: int, markers: int, effects: tuple[str, ...]) -> tuple[Array, Array]:
    """Information of #2 and of #1 with full propagated covariance on a random cell."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, dof, prismatic=(1,) if seed % 3 == 0 else ())
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), effects)
    poses = random_poses(rng, robot, 12)
    model = build(cell, poses).model
    values = model.sizes * rng.normal(size=len(model.parameters)) * 0.1
    points = model.predict(values, poses)
    seen = np.ones(points.shape[:2], dtype=bool)
    data = Measurements(poses, points, seen, np.full(seen.shape, np.nan))
    weights = np.linalg.inv(rng.normal(size=(*seen.shape, 3, 3)) + 4.0 * np.eye(3)) * 1e5
    marked = model.marker_positions(values)
    return (
        information(Points(model, data, weights), values),
        information(PoseObservation(model, data, weights, marked), values),
    )


@pytest.mark.parametrize("one_sees_all", [False, True])
def test_rows_are_those_of_what_was_read(one_sees_all: bool) -> None:
    """Of four markers two are seen at most poses: the others have no rows there, and lose nothing."""
    rng = np.random.default_rng(3)
    robot = random_robot(rng, 4, prismatic=())
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (4, 3)), ("base", "geometry"))
    poses = random_poses(rng, robot, 12)
    model = build(cell, poses).model
    values = model.sizes * rng.normal(size=len(model.parameters)) * 0.1
    read = model.predict(values, poses) + rng.normal(scale=1e-4, size=(12, 4, 3))
    seen = np.array([[k in (i % 4, (i * i) % 4) for k in range(4)] for i in range(12)])
    seen[5] |= one_sees_all
    data = Measurements(poses, read * seen[..., None], seen, np.full(seen.shape, np.nan))
    weights = (
        np.linalg.inv(rng.normal(size=(12, 4, 3, 3)) + 4.0 * np.eye(3)) * seen[..., None, None]
    )
    points = Points(model, data, weights)
    r, J = points.whitened(values)
    assert r.shape == (12, 12 if one_sees_all else 6)
    predicted, slopes = model.jacobian(values, poses)
    full = (weights @ (data.readings - predicted)[..., None])[..., 0]
    np.testing.assert_allclose(data.in_place(r), full, rtol=1e-12)
    columns = (weights @ slopes).reshape(12, 12, -1)
    np.testing.assert_allclose(
        information(points, values), sum(c.T @ c for c in columns), rtol=1e-9
    )
    packed = slopes[np.arange(12)[:, None], data.read]
    np.testing.assert_array_equal(points.rows(packed), J)
    some = np.array([7, 2])
    np.testing.assert_array_equal(data.in_place(r[some], some), data.in_place(r)[some])


def test_derivatives_in_parts_are_those_of_all_poses(
    kr270: Cell, table_two: Poses, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = build(kr270, table_two).model
    values = model.sizes * np.random.default_rng(0).normal(size=len(model.parameters)) * 0.1
    whole = replace(model).jacobian(values, table_two)
    monkeypatch.setattr("calib.arrays._AT_ONCE", 3 * whole[1][0].size)
    for part, expected in zip(replace(model).jacobian(values, table_two), whole, strict=True):
        np.testing.assert_allclose(part, expected, rtol=1e-9, atol=1e-12)


def test_unknown_marker_geometry_is_what_approach_one_cannot_see() -> None:
    points, pose = both(1, 6, 4, ("base", "tool", "geometry"))
    scale = np.sqrt(np.diag(points))
    loss = np.linalg.eigvalsh((points - pose) / np.outer(scale, scale))
    assert loss.min() > -1e-9, "condensing never adds information"
    assert np.sum(loss > 1e-6) == 3 * 4 - 6, "the shape of the marker set is lost, nothing else"


def test_names_and_shapes(kr270: Cell, table_two: Poses) -> None:
    names = calib.parameters(kr270, table_two)
    assert len(names) == len(set(names)) == 42
    assert calib.parameters(kr270) == names
    free_and_loaded = calib.observation(kr270, table_two)
    assert free_and_loaded.shape == (15, 2 * 9, 42)
    assert calib.observation(kr270, table_two, "pose").shape == (15, 2 * 6, 42)
    unloaded = with_effects(replace(kr270, load=None), "base", "tool", "geometry")
    assert calib.observation(unloaded, table_two.q).shape == (15, 9, 33)


@pytest.mark.parametrize("approach", ["points", "pose"])
def test_observation_is_the_derivative_of_the_prediction(
    kr270: Cell, table_two: Poses, approach: str
) -> None:
    cell = replace(kr270, load=Load(250.0, (0.3, 0.0, 0.15)))
    names = calib.parameters(cell)
    both_readings = calib.readings(cell, table_two)
    model = build(cell, both_readings).model

    def rows_at(values: Array) -> Array:
        points = calib.predict(cell, both_readings, values)
        if approach == "points":
            out = points.reshape(30, -1)
        else:
            from calib.arm.se3 import fit_rigid, so3_log

            T0 = fit_rigid(calib.predict(cell, both_readings, np.zeros(42)), cell.markers)
            T = fit_rigid(points, cell.markers)
            turn = so3_log(T[:, :3, :3] @ np.swapaxes(T0[:, :3, :3], 1, 2))
            out = np.concatenate([T[:, :3, 3], turn], axis=-1)
        return np.concatenate([out[:15], out[15:]], axis=1)

    def rows(values: Array) -> Array:
        return np.apply_along_axis(rows_at, -1, values)

    numeric = central_difference(rows, np.zeros(len(names)), model.sizes * 1e-2)
    analytic = calib.observation(cell, table_two, approach)  # type: ignore[arg-type]
    np.testing.assert_allclose(
        analytic, numeric, atol=1e-6 * np.abs(numeric).max(axis=(0, 1)).max()
    )


def test_values_by_name_and_by_position_agree(kr270: Cell, table_two: Poses) -> None:
    names = calib.parameters(kr270)
    by_name = {names[0]: 1.0, "joint_compliance:A3.compliance": 0.4e-6}
    vector = [by_name.get(name, 0.0) for name in names]
    np.testing.assert_array_equal(
        calib.predict(kr270, table_two, by_name), calib.predict(kr270, table_two, vector)
    )
    with pytest.raises(CalibError, match="no parameter 'A3'"):
        calib.predict(kr270, table_two, {"A3": 1.0})
    with pytest.raises(CalibError, match=r"shape \(2,\)"):
        calib.predict(kr270, table_two, [0.0, 1.0])


def test_hidden_markers_have_zero_rows(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "base", "tool", "geometry")
    seen = np.ones((15, 3), dtype=bool)
    seen[4, 1] = False
    data = Measurements(table_two, np.zeros((15, 3, 3)), seen, np.full((15, 3), np.nan))
    B = calib.observation(cell, data)
    assert not B[4, 3:6].any()
    assert np.abs(B[4, :3]).max() > 0
    assert not calib.observation(cell, data, "pose")[4].any()


DAYS = 15


def test_days_of_plain_poses_scatter_as_predicted(kr270: Cell) -> None:
    """Twelve poses under loads: first judged as if stiff, which sets bent poses aside for a while."""
    cell = with_effects(kr270, "base", "tool", "joint_compliance:A2,A3")
    cell = replace(cell, load=None)
    rng = np.random.default_rng(0)
    q = rng.uniform(*kr270.robot.limits.T, (12, 6))
    wrench = np.concatenate([rng.normal(size=(12, 3)) * 1500.0, np.zeros((12, 3))], axis=1)
    poses = poses_at(q, wrench=wrench)
    model = build(cell, poses).model
    truth = np.zeros(len(model.parameters))
    truth[-2:] = 3e-7, 4e-7
    squares, rank, outliers = 0.0, 0, 0
    for seed in range(DAYS):
        data = drawn_readings(model, truth, poses, cell.noise, np.random.default_rng(seed))
        found = calib.identify(cell, data, approach="pose", weighting="plain")
        outliers += int(found.fit.outlier.sum())
        error = (found.values - truth) / found.std
        values, vectors = np.linalg.eigh(found.correlation)
        squares += float(((error @ vectors) ** 2 / values).sum())
        rank += len(values)
    assert outliers <= 1
    assert 1e-3 < chi2.cdf(squares, rank) < 1.0 - 1e-3
