"""Predicted covariances and Monte Carlo refits of both approaches."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calib
import doe
from calib import Cell, Poses
from calib.arm.se3 import fit_rigid, rotate, transform
from calib.arrays import Array
from calib.errors import CalibError
from calib.noise import Noise
from calib.observations import with_measured_shape
from calib.poses import Measurements, poses_at
from studies.compare.agreement import agreement, band
from studies.compare.compare import PlanComparison, compare
from studies.compare.experiment import FULL, PLAIN, POINTS, WAYS, experiment_of
from studies.compare.make import compare_record
from studies.compare.prediction import predict
from tests.helpers import MADE_FROM, cell_of, random_poses, random_robot, read_by, with_effects


def fields_of(result: PlanComparison) -> dict[str, Any]:
    """What ``compare --json`` says of a result, without provenance."""
    return compare_record(result, MADE_FROM).model_dump()


def one_marker(cell: Cell) -> Cell:
    """The cell with its first marker alone."""
    return replace(
        cell,
        marker_names=("m1",),
        markers=cell.markers[:1],
        marker_normals=cell.marker_normals[:1],
        marker_acceptance=cell.marker_acceptance[:1],
    )


def random_cell(seed: int, dof: int, markers: int, *effects: str) -> tuple[Cell, Poses]:
    """A cell with nothing special about it and twelve poses in it."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, dof, prismatic=(1,) if seed % 3 == 0 else ())
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), effects)
    return cell, random_poses(rng, robot, 12)


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.integers(3, 7), st.integers(3, 6))
def test_full_covariance_makes_the_approaches_equal(seed: int, dof: int, markers: int) -> None:
    """For known marker geometry; base, geometry and compliances estimated, tracker noise."""
    cell, plan = random_cell(seed, dof, markers, "base", "geometry", "joint_compliance")
    cell = replace(cell, instruments=read_by(Noise(3e-6, 5e-6, 0.0, 2e-6)))
    experiment = experiment_of(cell, plan, seed=seed)
    found = {way.key: predict(experiment, way) for way in WAYS}
    points, full = found["points"].covariance, found["pose full"].covariance
    scale = np.sqrt(np.diag(points))
    scale[scale == 0.0] = 1.0
    np.testing.assert_allclose(
        full / np.outer(scale, scale), points / np.outer(scale, scale), atol=1e-9
    )
    known = np.isfinite(found["points"].std)
    np.testing.assert_allclose(found["pose full"].std[known], found["points"].std[known], rtol=1e-9)
    for key in ("pose plain", "pose normalised"):
        assert (found[key].std[known] > found["points"].std[known] * (1.0 - 1e-9)).all()


@pytest.mark.long
def test_prediction_is_the_inverse_of_the_information(kr270: Cell, table_two: Poses) -> None:
    """Against the observation matrices of the public interface, and against the design's figures."""
    experiment = experiment_of(kr270, table_two)
    B = calib.observation(kr270, table_two).reshape(-1, 42) / kr270.noise.across
    scale = np.linalg.norm(B, axis=0)
    std = np.sqrt(np.diag(np.linalg.inv((B / scale).T @ (B / scale)))) / scale
    np.testing.assert_allclose(predict(experiment, POINTS).std, std, rtol=1e-6)
    plan = doe.design(kr270, criterion="D", candidates=600)
    rival = compare(kr270, {"own": plan.poses}, trials=0).plans[0]
    points = rival.of(POINTS)
    assert points is not None
    np.testing.assert_allclose(points.prediction.std, plan.assessment.std, rtol=1e-6)
    assert points.task_rms == pytest.approx(plan.assessment.task_rms, rel=1e-6)
    assert points.task_worst == pytest.approx(plan.assessment.task_worst, rel=1e-6)


@pytest.mark.long
def test_five_hundred_refits_scatter_as_predicted(kr270: Cell, table_two: Poses) -> None:
    """Both approaches, every weighting, a robot that is off, free and loaded: nonlinear throughout."""
    elastic = [e for e in kr270.effects if "stiffness" in e or "compliance" in e]
    cell = with_effects(kr270, "base", "tool", *elastic)
    result = compare(cell, {"Table II": table_two}, trials=500, seed=1)
    for verdict in result.plans[0].verdicts:
        found = verdict.agreement
        assert found is not None
        assert found.trials == 500
        low, high = band(500, 0.9999)
        assert low < found.ratio.min()
        assert found.ratio.max() < high
        assert np.abs(found.bias_share).max() < 4.5
        assert found.p > 1e-3
        assert verdict.simulated_rms == pytest.approx(verdict.task_rms, rel=0.05)
    assert result.p is not None
    assert result.p > 1e-3


def test_given_values_are_where_it_is_predicted_and_simulated(
    kr270: Cell, table_two: Poses
) -> None:
    values = dict.fromkeys(calib.parameters(kr270), 0.0) | {"joint_compliance:A3.compliance": 4e-7}
    study = compare(kr270, {"p": table_two}, trials=0, values=values).plans[0]
    np.testing.assert_array_equal(study.experiment.truth, study.experiment.nominal)
    assert study.experiment.nominal.max() == 4e-7
    with pytest.raises(CalibError, match="no parameter 'nonsense'"):
        compare(kr270, {"p": table_two}, trials=0, values={"nonsense": 1.0})


def test_one_marker_leaves_approach_two(kr270: Cell, table_two: Poses) -> None:
    study = compare(one_marker(kr270), {"p": table_two}, trials=20).plans[0]
    assert [v.way for v in study.verdicts] == [POINTS]
    assert study.improvement is None
    assert study.of(PLAIN) is None


def test_a_parameter_that_the_plan_leaves_open_is_said(kr270: Cell, table_two: Poses) -> None:
    """A1 parallel to gravity: its compliance cannot be seen, the others can."""
    cell = with_effects(
        kr270, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6", "joint_offset:A1"
    )
    few = table_two.take(np.arange(3))
    study = compare(cell, {"three": few}, trials=20).plans[0]
    points = study.of(POINTS)
    assert points is not None
    open_ = np.isnan(points.prediction.std)
    assert open_.any()
    assert np.isfinite(points.prediction.std).any()
    assert points.task_rms == np.inf
    assert points.agreement is not None
    assert np.isnan(points.agreement.ratio[open_]).all()
    assert not study.refits.errors["points"][:, open_].any()
    fields = fields_of(compare(cell, {"three": few}, trials=0))
    assert json.dumps(fields["plans"][0]["plan"]) == '"three"'


# -- agreement ---------------------------------------------------------------------------------


def drawn(cov: Array, trials: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov, trials)


COV = np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 9.0]]) * 1e-12


def test_p_values_are_uniform_or_rarer_where_the_prediction_is_right() -> None:
    found = [agreement(drawn(COV, 200, seed), COV) for seed in range(400)]
    p = np.array([own.p for own in found if own is not None])
    for level in (0.01, 0.05, 0.2):
        assert np.mean(p < level) < level + 3.0 * np.sqrt(level / 400)
    assert np.mean(p < 0.2) > 0.03, "and not for want of power"


@pytest.mark.parametrize(
    "errors",
    [
        drawn(COV * 1.3, 500),
        drawn(COV / 1.3, 500),
        drawn(COV, 500) + np.array([0.3e-6, 0.0, 0.0]),
        drawn(np.diag(np.diag(COV)), 500),
    ],
    ids=["too wide", "too narrow", "biased", "uncorrelated"],
)
def test_a_wrong_prediction_is_refuted(errors: Array) -> None:
    found = agreement(errors, COV)
    assert found is not None
    assert found.p < 1e-3


def test_agreement_of_directions_that_are_fixed_and_of_nothing() -> None:
    joined = np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e-12
    errors = np.repeat(np.random.default_rng(0).normal(0.0, 1e-6, (300, 1)), 2, axis=1)
    found = agreement(errors, joined)
    assert found is not None
    assert found.p > 0.01
    assert found.total == pytest.approx(1.0, abs=0.3)
    assert agreement(errors[:1], joined) is None
    assert agreement(errors, np.zeros((2, 2))) is None


def parallel_arm(seed: int, markers: int, *effects: str) -> tuple[Cell, Poses]:
    """Four parallel axes and a slide along them: base and markers share a direction."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 4, prismatic=(2,))
    turned = np.broadcast_to(np.eye(3), (5, 3, 3))
    shifted = np.array([[0, 0, 0.4], [0.3, 0, 0], [0.25, 0, 0.1], [0, 0, 0], [0, 0, -0.1]])
    robot = replace(
        robot, origins=transform(turned, shifted), axes=np.tile([0.0, 0.0, 1.0], (4, 1))
    )
    points = rng.uniform(-0.1, 0.1, (markers, 3))
    low, high = robot.sample_limits().T
    return cell_of(robot, points, effects), poses_at(rng.uniform(low, high, (15, 4)))


@pytest.mark.long
def test_no_way_is_better_than_the_points_where_base_and_tool_overlap() -> None:
    """One marker component is dropped there; the shape that #1 measures must not mix with it."""
    cell, plan = parallel_arm(1, 3, "base", "tool", "geometry")
    assert len(calib.parameters(cell)) < 6 + 9 + 18
    study = compare(cell, {"p": plan}, trials=300).plans[0]
    points = study.of(POINTS)
    assert points is not None
    for verdict in study.verdicts:
        assert (verdict.prediction.std > points.prediction.std * (1.0 - 1e-6)).all()
        assert verdict.agreement is not None
        assert verdict.agreement.p > 1e-3, verdict.way.key
    full = study.of(FULL)
    assert full is not None
    np.testing.assert_allclose(full.prediction.std, points.prediction.std, rtol=1e-6)


def test_open_parameters_are_the_same_for_every_way(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "base", "tool", "geometry")
    few = replace(table_two.take(np.arange(4)))
    study = compare(replace(cell, load=None), {"few": few}, trials=0).plans[0]
    robot = [p.effect == "geometry" for p in study.experiment.model.parameters]
    points = study.of(POINTS)
    assert points is not None
    open_ = np.isnan(points.prediction.std)[robot]
    assert open_.any()
    for verdict in study.verdicts:
        assert not (np.isfinite(verdict.prediction.std)[robot] & open_).any()


def test_a_load_effect_is_predicted_on_an_elastic_arm(kr270: Cell, table_two: Poses) -> None:
    """On a rigid one it would move nothing, and every figure would be undefined."""
    elastic = [e for e in kr270.effects if "stiffness" in e or "compliance" in e]
    anchors = {"A2": np.array([[-0.686, 0.0, 0.123], [0.185, 0.0, 0.0]])}
    cell = replace(with_effects(kr270, *elastic, "gravity_compensator:A2"), anchors=anchors)
    study = compare(cell, {"p": table_two}, trials=0).plans[0]
    for verdict in study.verdicts:
        assert np.isfinite(verdict.prediction.std).all()


def test_shape_of_markers_seen_in_turn_is_the_best_fit(kr270: Cell, table_two: Poses) -> None:
    """Six markers, three at a time: the least-squares shape, against SciPy."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(0)
    cell = with_effects(cell_of(kr270.robot, rng.uniform(-0.2, 0.2, (6, 3)), ()), "base", "tool")
    experiment = experiment_of(cell, table_two)
    seen = np.zeros((15, 6), dtype=bool)
    for i in range(15):
        seen[i, rng.permutation(6)[:4]] = True
    exact = experiment.model.predict(experiment.nominal, experiment.poses)
    points = exact + 1e-5 * rng.standard_normal(exact.shape)
    data = Measurements(experiment.poses, points, seen, np.full(seen.shape, np.nan))
    measured = with_measured_shape(experiment.model, data, experiment.nominal)
    shape = experiment.model.marker_positions(measured)

    def misfit(flat: Array) -> Array:
        own = flat.reshape(6, 3)
        T = fit_rigid(points, own, seen.astype(float))
        rest = points - rotate(T[:, None, :3, :3], own) - T[:, None, :3, 3]
        return (rest * seen[..., None]).ravel() * 1e5

    best = least_squares(misfit, cell.markers.ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    ours = float((misfit(shape.ravel()) ** 2).sum())
    assert ours == pytest.approx(2.0 * best.cost, rel=1e-6)


@pytest.mark.long
def test_too_few_trials_and_fits_that_fail_are_no_belief(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "stiffness_vs_angle:A2", "joint_compliance:A3,A4")
    few = fields_of(compare(cell, {"p": table_two}, trials=5))["agreement"]
    assert few["believed"] is None
    assert "too few to tell" in few["says"]
    result = compare(cell, {"p": table_two}, trials=40)
    study = result.plans[0]
    lost = tuple(replace(v, unsettled=3) for v in study.verdicts)
    worse = replace(result, plans=(replace(study, verdicts=lost),))
    found = fields_of(worse)["agreement"]
    assert found["believed"] is False
    assert "3 of 40 fits" in found["says"]
