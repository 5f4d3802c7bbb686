"""Predicted covariances and Monte Carlo refits of both approaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

import calib
import doe
from calib import Cell, Poses
from calib.arm.se3 import fit_rigid, rotate, transform
from calib.arrays import Array
from calib.noise import Noise
from calib.observations import with_measured_shape
from calib.poses import Measurements, poses_at
from studies.compare.experiment import POINTS, WAYS, experiment_of, predict
from studies.compare.simulate import agreement, refits
from studies.results.compare import (
    ComparedApproach,
    ComparedPlan,
    CompareResult,
    OverallAgreement,
    compared,
)
from tests.helpers import MADE_FROM, cell_of, random_poses, random_robot, read_by, with_effects


def compare(cell: Cell, plan: Poses, trials: int = 0, seed: int = 0) -> ComparedPlan:
    """One plan, compared."""
    (found,) = compared(cell, {"p": plan}, trials, seed=seed)
    return found


def together(cell: Cell, plan: ComparedPlan, trials: int) -> OverallAgreement:
    """What all trials of a plan say."""
    return CompareResult.of(cell, [plan], trials, MADE_FROM).agreement


def known_std(own: ComparedApproach) -> Array:
    """Standard deviations in their units, NaN where open."""
    return np.array([p.std for p in own.parameters], dtype=float)


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
    points = compare(kr270, plan.poses).points
    scales = [p.scale for p in plan.problem.model.parameters]
    np.testing.assert_allclose(known_std(points) * scales, plan.assessment.std, rtol=1e-6)
    assert points.task_rms_mm == pytest.approx(1e3 * plan.assessment.task_rms, rel=1e-6)
    assert points.task_worst_mm == pytest.approx(1e3 * plan.assessment.task_worst, rel=1e-6)


@pytest.mark.long
def test_five_hundred_refits_scatter_as_predicted(kr270: Cell, table_two: Poses) -> None:
    """Both approaches, every weighting, a robot that is off, free and loaded: nonlinear throughout."""
    elastic = [e for e in kr270.effects if "stiffness" in e or "compliance" in e]
    cell = with_effects(kr270, "base", "tool", *elastic)
    found = compare(cell, table_two, 500, seed=1)
    low, high = np.sqrt(chi2.ppf([5e-5, 1 - 5e-5], 499) / 499)
    for own in found.approaches:
        ratio = np.array([p.monte_carlo_std for p in own.parameters]) / known_std(own)
        assert low < ratio.min()
        assert ratio.max() < high
        assert own.agreement is not None
        assert own.agreement.chi2_p is not None
        assert own.agreement.chi2_p > 1e-3
        assert own.monte_carlo_task_rms_mm == pytest.approx(own.task_rms_mm, rel=0.05)
    assert together(cell, found, 500).believed is True


def test_one_marker_leaves_approach_two(kr270: Cell, table_two: Poses) -> None:
    found = compare(one_marker(kr270), table_two, 20)
    assert [own.key for own in found.approaches] == ["points"]
    assert not found.improvement


def test_a_parameter_that_the_plan_leaves_open_is_said(kr270: Cell, table_two: Poses) -> None:
    """A1 parallel to gravity: its compliance cannot be seen, the others can."""
    cell = with_effects(
        kr270, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6", "joint_offset:A1"
    )
    few = table_two.take(np.arange(3))
    points = compare(cell, few, 20).points
    open_ = np.isnan(known_std(points))
    assert open_.any()
    assert not open_.all()
    assert points.task_rms_mm is None
    simulated = np.array([p.monte_carlo_std for p in points.parameters], dtype=float)
    np.testing.assert_array_equal(np.isnan(simulated), open_)
    experiment = experiment_of(cell, few)
    done = refits(experiment, [predict(experiment, POINTS)], 20)
    assert not done["points"].errors[:, open_].any()


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
    found = compare(cell, plan, 300)
    for own in found.approaches:
        assert (known_std(own) > known_std(found.points) * (1.0 - 1e-6)).all()
        assert own.agreement is not None
        assert own.agreement.chi2_p is not None
        assert own.agreement.chi2_p > 1e-3, own.key
    (full,) = (own for own in found.approaches if own.key == "pose full")
    np.testing.assert_allclose(known_std(full), known_std(found.points), rtol=1e-6)


def test_open_parameters_are_the_same_for_every_way(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "base", "tool", "geometry")
    few = replace(table_two.take(np.arange(4)))
    found = compare(replace(cell, load=None), few)
    robot = [p.effect == "geometry" for p in found.points.parameters]
    open_ = np.isnan(known_std(found.points))[robot]
    assert open_.any()
    for own in found.approaches:
        assert not (np.isfinite(known_std(own))[robot] & open_).any()


def test_a_load_effect_is_predicted_on_an_elastic_arm(kr270: Cell, table_two: Poses) -> None:
    """On a rigid one it would move nothing, and every figure would be undefined."""
    elastic = [e for e in kr270.effects if "stiffness" in e or "compliance" in e]
    anchors = {"A2": np.array([[-0.686, 0.0, 0.123], [0.185, 0.0, 0.0]])}
    cell = replace(with_effects(kr270, *elastic, "gravity_compensator:A2"), anchors=anchors)
    for own in compare(cell, table_two).approaches:
        assert np.isfinite(known_std(own)).all()


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
    few = together(cell, compare(cell, table_two, 5), 5)
    assert few.believed is None
    assert "too few to tell" in few.says
    found = compare(cell, table_two, 40)
    failed = [own.model_copy(update={"not_converged": 3}) for own in found.approaches]
    worse = together(cell, found.model_copy(update={"approaches": tuple(failed)}), 40)
    assert worse.believed is False
    assert "3 of 40 fits" in worse.says
