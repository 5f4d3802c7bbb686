"""The model: its irreducible geometry, its observations of both approaches, its covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.stats import chi2

import calib
from calib import Cell, Poses
from calib.arm.se3 import fit_rigid, so3_log
from calib.arrays import Array
from calib.cell import Load
from calib.cell.targets import targets_of
from calib.effects.geometry import LinkGeometry
from calib.effects.protocol import Effect
from calib.errors import CalibError, EffectCannotAct
from calib.model import Model
from calib.model.build import build, context_of
from calib.model.covariance import accuracy, covariance, determined, errors_at, ignorance
from calib.model.reduction import generic_configurations
from calib.observations import Points, PoseObservation
from calib.poses import Measurements, poses_at
from calib.prediction.estimate import estimate_of
from calib.simulation import drawn_readings
from calib.solver import condensed, inverse_factor, levenberg_marquardt
from doe.forecast.enough import enough
from tests.day import ON_TOOL, RIGID, cell_of_day, whole_day
from tests.helpers import (
    all_seen,
    cell_of,
    central_difference,
    model_of,
    random_poses,
    random_robot,
    simulated,
    with_effects,
)
from tests.touched_arm import parallel

# -- Ranks of the KR 270, and completeness on chains of any kind


def scaled_matrix(model: Model) -> Array:
    poses = poses_at(generic_configurations(model.robot, 60) * 0.9)
    _, J = model.jacobian(np.zeros(len(model.parameters)), poses)
    J = J.reshape(-1, J.shape[-1])
    return J / np.linalg.norm(J, axis=0)


def rank(*X: Array, tol: float = 1e-7) -> int:
    return int(np.linalg.matrix_rank(np.hstack(X), tol=tol))


def everywhere(cell: Cell, kinds: Sequence[str]) -> tuple[Effect, ...]:
    """Effects at every place that they may have."""
    return model_of(context_of(cell, None), kinds).effects


# Without base and tool a 6R arm has all 30 pose parameters; a joint's offset is part of geometry.
@pytest.mark.parametrize(
    ("markers", "effects", "count"),
    [
        (1, RIGID, 27),
        (2, RIGID, 30),
        (3, RIGID, 33),
        (3, ("geometry",), 30),
        (3, (*RIGID, "joint_offset"), 33),
        (3, (*RIGID[:2], "geometry:A1,A2,A3,A4,A5,A6,tool0"), 33),
    ],
)
def test_how_many_are_left_to_identify(
    kr270: Cell, markers: int, effects: Sequence[str], count: int
) -> None:
    cell = cell_of(kr270.robot, ON_TOOL[:markers], effects)
    assert len(calib.parameters(cell)) == count
    singular = np.linalg.svd(scaled_matrix(build(cell).model), compute_uv=False)
    assert singular[0] / singular[-1] < 100.0, "and the chosen set is well conditioned"


PUBLISHED = {
    "A2": "x y rx ry",
    "A3": "x rx rz ry",
    "A4": "x z rz rx",
    "A5": "y z rz ry",
    "A6": "z rz",
}


def test_published_set_spans_the_same(kr270: Cell) -> None:
    """The 18 parameters of the RCIM 2015 companion paper move the markers as the reduced set does."""
    cell = cell_of(kr270.robot, ON_TOOL, RIGID)
    reduced, placed = build(cell).model, list(everywhere(cell, RIGID[:2]))
    for joint, names in PUBLISHED.items():
        components = tuple(LinkGeometry.names.index(name) for name in names.split())
        own = LinkGeometry.at(context_of(cell, None), joint)
        placed.append(replace(own, components=components))
    ours, theirs = (scaled_matrix(m) for m in (reduced, reduced.with_effects(tuple(placed))))
    assert theirs.shape[1] == 33
    assert rank(theirs, tol=1e-6) == rank(ours, tol=1e-6) == rank(theirs, ours, tol=1e-6) == 33


@pytest.mark.parametrize(
    ("dof", "prismatic"),
    [(1, ()), (2, ()), (3, (1,)), (5, ()), (7, ()), (6, (0, 3)), (9, ()), ("SCARA", (2,))],
)
@pytest.mark.parametrize("markers", [1, 3])
@pytest.mark.parametrize("effects", [RIGID[:2], RIGID])
def test_reduced_set_is_complete_and_irreducible(
    dof: int | str, prismatic: tuple[int, ...], markers: int, effects: tuple[str, ...]
) -> None:
    """Against the rank of all six errors of every segment, with base and markers.

    A SCARA cannot tell the height of its markers from that of its base.
    """
    count = dof if isinstance(dof, int) else 3
    rng = np.random.default_rng(count)
    robot = random_robot(rng, count, prismatic)
    if dof == "SCARA":
        robot = parallel(robot)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), effects)
    reduced = build(cell).model
    X, full = scaled_matrix(reduced), reduced.with_effects(everywhere(cell, effects))
    assert rank(X) == X.shape[1] == rank(scaled_matrix(full))


def test_rounding_does_not_choose_between_equals(kr270: Cell) -> None:
    """Of two shifts that are one, the same stays whatever the last digits of the model are."""
    rng, found = np.random.default_rng(0), set()
    for _ in range(6):
        origins = kr270.robot.origins * (1.0 + 1e-15 * rng.standard_normal((7, 4, 4)))
        robot = replace(kr270.robot, origins=origins)
        found.add(tuple(calib.parameters(cell_of(robot, ON_TOOL, RIGID))))
    assert len(found) == 1


def test_every_dropped_parameter_is_explained(kr270: Cell) -> None:
    dropped = build(cell_of(kr270.robot, ON_TOOL, RIGID)).dropped
    assert len(dropped) == 42 - 18
    names = {d.id: {name for name, _ in d.absorbed_by} for d in dropped}
    assert "base:base.z" in names["geometry:A1.z"]
    assert names["geometry:tool0.x"] == {f"tool:marker:m{j}.x" for j in (1, 2, 3)}


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        (("base", "joint_offset:A1"), r"base:base.rz moves the markers in the same way"),
        ((*RIGID[:2], "geometry:A1"), r"geometry cannot act: base:base.* move the markers"),
    ],
)
def test_what_others_absorb_is_refused_where_it_was_asked_for(
    kr270: Cell, effects: Sequence[str], said: str
) -> None:
    with pytest.raises(EffectCannotAct, match=said):
        build(cell_of(kr270.robot, ON_TOOL, effects))


@pytest.mark.parametrize("ends", [("base", "tool"), ("tool",), ()])
def test_geometry_at_places_is_what_can_be_told_apart_there(
    kr270: Cell, ends: tuple[str, ...]
) -> None:
    """As many as the rank of six constants at each of these frames beside base and markers."""
    built = build(cell_of(kr270.robot, ON_TOOL, [*ends, "geometry:A2,A4,tool0"]))
    places = {"A2", "A4", "tool0"}
    assert {p.where for p in built.model.parameters if p.effect == "geometry"} <= places
    assert {e.where for e in built.full.effects if e.kind == "geometry"} == places
    own, full = (rank(scaled_matrix(m), tol=1e-6) for m in (built.model, built.full))
    assert len(built.model.parameters) == own == full


# -- Observation matrices of both approaches


def information(observation: Points | PoseObservation, values: Array) -> Array:
    _, J = observation.linearise(values)
    J = J.reshape(-1, J.shape[-1])
    return J.T @ J


def drawn(
    seed: int, markers: int, effects: tuple[str, ...], dof: int
) -> tuple[Model, Poses, Array, np.random.Generator]:
    """A random arm that errs, at twelve poses."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, dof)
    poses = random_poses(rng, robot, 12)
    model = build(cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), effects), poses).model
    return model, poses, model.sizes * rng.normal(size=len(model.parameters)) * 0.1, rng


@pytest.mark.parametrize("one_sees_all", [False, True])
def test_rows_are_those_of_what_was_read(one_sees_all: bool) -> None:
    """Of four markers two are seen at most poses: the others have no rows there, and lose nothing."""
    model, poses, values, rng = drawn(3, 4, ("base", "geometry"), 4)
    read = model.predict(values, poses) + rng.normal(scale=1e-4, size=(12, 4, 3))
    seen = np.array([[k in (i % 4, (i * i) % 4) for k in range(4)] for i in range(12)])
    seen[5] |= one_sees_all
    data = Measurements(poses, read * seen[..., None], seen, np.full(seen.shape, np.nan))
    weights = np.linalg.inv(rng.normal(size=(12, 4, 3, 3)) + 4.0 * np.eye(3))
    weights *= seen[..., None, None]
    points = Points(model, data, weights)
    r, J = points.whitened(values)
    assert r.shape == (12, 12 if one_sees_all else 6)
    predicted, slopes = model.jacobian(values, poses)
    full = (weights @ (data.readings - predicted)[..., None])[..., 0]
    np.testing.assert_allclose(data.in_place(r), full, rtol=1e-12)
    columns = (weights @ slopes).reshape(144, -1)
    np.testing.assert_allclose(information(points, values), columns.T @ columns, rtol=1e-9)
    np.testing.assert_array_equal(points.rows(slopes[np.arange(12)[:, None], data.read]), J)
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
    model, poses, values, rng = drawn(1, 4, RIGID, 6)
    data = all_seen(poses, model.predict(values, poses))
    weights = np.linalg.inv(rng.normal(size=(*data.seen.shape, 3, 3)) + 4.0 * np.eye(3)) * 1e5
    points = information(Points(model, data, weights), values)
    marked = model.marker_positions(values)
    pose = information(PoseObservation(model, data, weights, marked), values)
    scale = np.sqrt(np.diag(points))
    loss = np.linalg.eigvalsh((points - pose) / np.outer(scale, scale))
    assert loss.min() > -1e-9, "condensing never adds information"
    assert np.sum(loss > 1e-6) == 3 * 4 - 6, "the shape of the marker set is lost, nothing else"


def test_names_shapes_and_values(kr270: Cell, table_two: Poses) -> None:
    names = calib.parameters(kr270, table_two)
    assert len(names) == len(set(names)) == 42
    assert calib.parameters(kr270) == names
    assert calib.observation(kr270, table_two).shape == (15, 2 * 9, 42)
    unloaded = with_effects(replace(kr270, load=None), *RIGID)
    assert calib.observation(unloaded, table_two.q).shape == (15, 9, 33)
    by_name = {names[0]: 1.0, "joint_compliance:A3.compliance": 0.4e-6}
    vector = [by_name.get(name, 0.0) for name in names]
    both = (calib.predict(kr270, table_two, values) for values in (by_name, vector))
    np.testing.assert_array_equal(*both)
    with pytest.raises(CalibError, match="no parameter 'A3'"):
        calib.predict(kr270, table_two, {"A3": 1.0})
    with pytest.raises(CalibError, match=r"shape \(2,\)"):
        calib.predict(kr270, table_two, [0.0, 1.0])


def test_observation_of_poses_is_the_derivative_of_a_fit_to_points(
    kr270: Cell, table_two: Poses
) -> None:
    """Free and loaded at five poses; that of points is the model's Jacobian."""
    plan = table_two.take(slice(0, 15, 3))
    cell = replace(kr270, load=Load(250.0, (0.3, 0.0, 0.15)))
    readings = calib.readings(cell, plan)
    model = build(cell, readings).model
    T0 = fit_rigid(calib.predict(cell, readings, np.zeros(42)), cell.markers)

    def rows_at(values: Array) -> Array:
        T = fit_rigid(model.predict(values, readings), cell.markers)
        turn = so3_log(T[:, :3, :3] @ np.swapaxes(T0[:, :3, :3], 1, 2))
        out = np.concatenate([T[:, :3, 3], turn], axis=-1)
        return np.concatenate([out[:5], out[5:]], axis=1)

    def rows(values: Array) -> Array:
        return np.apply_along_axis(rows_at, -1, values)

    numeric = central_difference(rows, np.zeros(42), model.sizes * 1e-2)
    analytic = calib.observation(cell, plan, "pose")
    np.testing.assert_allclose(analytic, numeric, atol=1e-6 * np.abs(numeric).max())
    _, J = model.jacobian(np.zeros(42), readings)
    both = np.concatenate([J[:5].reshape(5, 9, -1), J[5:].reshape(5, 9, -1)], axis=1)
    np.testing.assert_allclose(calib.observation(cell, plan), both, atol=1e-12)


def test_hidden_markers_have_zero_rows(kr270: Cell, table_two: Poses) -> None:
    seen = np.ones((15, 3), dtype=bool)
    seen[4, 1] = False
    data = Measurements(table_two, np.zeros((15, 3, 3)), seen, np.full((15, 3), np.nan))
    cell = with_effects(kr270, *RIGID)
    B = calib.observation(cell, data)
    assert not B[4, 3:6].any()
    assert np.abs(B[4, :3]).max() > 0
    assert not calib.observation(cell, data, "pose")[4].any()


def test_days_of_plain_poses_scatter_as_predicted(kr270: Cell) -> None:
    """Twelve poses under loads: first judged as if stiff, which sets bent poses aside for a while.

    No right pose goes as an outlier.
    """
    cell = with_effects(replace(kr270, load=None), "base", "tool", "joint_compliance:A2,A3")
    rng = np.random.default_rng(0)
    q = rng.uniform(*kr270.robot.limits.T, (12, 6))
    poses = poses_at(q, wrench=rng.normal(size=(12, 6)) * np.repeat([1500.0, 0.0], 3))
    model = build(cell, poses).model
    truth = np.zeros(len(model.parameters))
    truth[-2:] = 3e-7, 4e-7
    squares, count, outliers = 0.0, 0, 0
    for seed in range(8):
        data = drawn_readings(model, truth, poses, cell.noise, np.random.default_rng(seed))
        found = calib.identify(cell, data, approach="pose", weighting="plain")
        outliers += int(found.fit.outlier.sum())
        values, vectors = np.linalg.eigh(found.correlation)
        squares += float(((((found.values - truth) / found.std) @ vectors) ** 2 / values).sum())
        count += len(values)
    assert outliers <= 1
    assert 1e-3 < chi2.cdf(squares, count) < 1.0 - 1e-3


# -- Covariances in a span, and what was not estimated adds to them


def test_it_is_the_bayesian_covariance_with_a_prior_on_what_was_lost() -> None:
    """Two of six columns are sums of others; J^T J + 1 / size^2 is inverted as it stands."""
    rng = np.random.default_rng(0)
    J = rng.normal(size=(30, 6))
    J[:, 4:] = J[:, :4] @ rng.normal(size=(4, 2))
    sizes, lost = np.array([1.0, 0.3, 1e-3, 20.0, 5.0, 1e-2]), np.arange(6) >= 4
    span = np.eye(6)[:, ~lost]
    total = covariance(J, span) + ignorance(J, span, sizes, lost)
    honest = np.linalg.inv(J.T @ J + np.diag(lost / sizes**2))
    np.testing.assert_allclose(total, honest, rtol=1e-8, atol=1e-12)
    # With a prior on every value, as that of a designer, less is open: never more.
    with_all = np.linalg.inv(J.T @ J + np.diag(1.0 / sizes**2))
    assert np.linalg.eigvalsh((total - with_all) / np.outer(sizes, sizes)).min() > -1e-9
    # What was measured is predicted as well as if nothing were lost.
    np.testing.assert_allclose(J @ total @ J.T, J @ covariance(J, span) @ J.T, atol=1e-9)


def test_what_shows_nowhere_has_no_deviation_and_keeps_its_size(rng: np.random.Generator) -> None:
    J, lost = np.column_stack([rng.normal(size=(12, 2)), np.zeros(12)]), np.arange(3) == 2
    for span in (np.eye(3), np.eye(3)[:, :2]):
        found = covariance(J, span)
        np.testing.assert_allclose(found[:2, :2], np.linalg.inv(J[:, :2].T @ J[:, :2]))
        assert not found[2].any()
    unknown = ignorance(J, np.eye(3)[:, :2], np.array([1.0, 1.0, 3.0]), lost)
    np.testing.assert_allclose(unknown, np.diag([0.0, 0.0, 9.0]), atol=1e-12)
    assert np.isfinite(ignorance(J, np.eye(3), np.ones(3), lost)).all()


def test_values_whose_direction_is_in_the_span_are_determined(rng: np.random.Generator) -> None:
    eye = np.eye(5)
    span = np.column_stack([eye[0], eye[2], (eye[3] + eye[4]) / np.sqrt(2.0)])
    for basis in (span, span @ rng.normal(size=(3, 3))):
        assert list(determined(basis)) == [True, False, True, False, False]
    assert determined(rng.normal(size=(5, 5))).all()
    assert not determined(np.zeros((5, 0))).any()


OPEN = ("gravity_compensator:A2", "gravity_sag:A2", "link_weight:A2")


@pytest.mark.parametrize(
    ("sizes", "rel"), [pytest.param("off", 1e-6, marks=pytest.mark.long), ("estimated", 1e-4)]
)
def test_identify_compensate_and_enough_expect_the_same(
    kr270: Cell, table_two: Poses, sizes: Literal["off", "estimated"], rel: float
) -> None:
    """Beside sizes of the others the forecast estimates what identify leaves where it was."""
    cell = cell_of_day(kr270)
    cell = replace(with_effects(cell, *cell.effects, *OPEN), size_prior=sizes)
    data = whole_day(cell, table_two)
    result = calib.identify(cell, data)
    assert result.unidentifiable
    told = accuracy(result.model, result.values, result.knowledge, *targets_of(cell))
    np.testing.assert_array_equal(estimate_of(result).covariance, result.knowledge)
    now = enough(cell, data).steps[0]
    assert (now.task_rms, now.task_worst) == pytest.approx(told, rel=rel)


def test_poses_that_were_measured_are_known_whatever_was_lost(
    kr270: Cell, table_two: Poses
) -> None:
    data, _, _ = simulated(kr270, table_two, 0)
    result = calib.identify(with_effects(kr270, *kr270.effects, *OPEN), data)
    assert result.unidentifiable
    poses = data.poses.take(~result.fit.outlier)
    alone, told = (
        errors_at(result.model, result.values, cov, poses)
        for cov in (result.covariance, result.knowledge)
    )
    np.testing.assert_allclose(told, alone, rtol=0.05)


# -- Many small matrices against numpy's of one, and minima that are none


@pytest.mark.parametrize("wrong", [0.0, -1.0])
@pytest.mark.parametrize("count", [5, 80])
def test_one_matrix_that_is_not_positive_definite_is_refused(count: int, wrong: float) -> None:
    V = np.repeat(np.eye(4)[None], count, axis=0)
    V[3, 2, 2] = wrong
    with pytest.raises(np.linalg.LinAlgError):
        inverse_factor(V)


def test_a_covariance_singular_by_rounding_has_a_factor() -> None:
    """A level of noise beyond all others leaves the small ones below rounding."""
    H = np.random.default_rng(0).normal(size=(3, 20, 4))
    V = 1e17 * H @ np.swapaxes(H, -1, -2) + np.eye(20)
    for some in (V, V[:, :6, :6].repeat(30, axis=0)):
        assert np.isfinite(inverse_factor(some)).all()


@pytest.mark.parametrize("residual", [lambda v: 1.0 - v, lambda v: v * np.nan])
def test_the_solver_does_not_call_a_dead_end_a_minimum(residual) -> None:  # type: ignore[no-untyped-def]
    """A slope the wrong way, and no number at all."""
    start = np.zeros(1), np.eye(1)
    assert not levenberg_marquardt(lambda v: (residual(v), -np.eye(1)), *start).converged


@pytest.mark.parametrize("shape", [(9, 12), (300, 12), (40_000, 12), (700, 130)])
def test_condensed_columns_have_the_same_products(shape: tuple[int, int]) -> None:
    """The last of them nearly the sum of the others, which squares would not show."""
    A = np.random.default_rng(1).normal(size=shape)
    A[:, -1] = A[:, :-1].sum(axis=1) + 1e-9 * A[:, -1]
    found = condensed(A)
    assert len(found) <= shape[1]
    np.testing.assert_allclose(found.T @ found, A.T @ A, rtol=1e-9, atol=1e-9 * shape[0])
    apart = np.append(-np.ones(shape[1] - 1), 1.0)
    np.testing.assert_allclose(np.linalg.norm(found @ apart), np.linalg.norm(A @ apart), rtol=1e-4)
