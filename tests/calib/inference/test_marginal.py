"""Estimate, covariance, freedom and evidence against dense matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import kstest

from calib.arrays import Array
from calib.inference import Design, GaussianBlock, Marginal, Prior
from calib.inference.prior import penalty
from calib.inference.reml import reml
from tests.calib.inference.designs import GROUPS, POSES, ROWS, Dense, random_design, random_theta


def at(design: Design, theta: Array, prior: Prior | None = None) -> Marginal:
    return Marginal.at(design, design.variances(theta), prior)


def least_squares_map(dense: Dense) -> Array:
    """How values of b follow the response, by noise and priors of blocks, (s, N)."""
    design, W = dense.design, np.linalg.inv(dense.noise)
    amplitudes = design.variances(dense.theta).amplitudes
    of = design.block_of_column
    X = design.columns * np.append(amplitudes, 1.0)[of]
    return (np.linalg.solve(X.T @ W @ X + np.diag(1.0 * (of >= 0)), X.T @ W))[of < 0]


@pytest.mark.parametrize("groups", list(GROUPS))
def test_estimate_and_covariance_are_those_of_dense_matrices(groups: str) -> None:
    """Of least squares by noise and priors, the rows as the whole model draws them."""
    design = random_design(groups)
    theta = random_theta(design)
    found, dense = at(design, theta), Dense(design, theta)
    G = least_squares_map(dense)
    np.testing.assert_allclose(found.estimate, G @ design.response, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, G @ dense.V @ G.T, rtol=1e-8, atol=1e-12)
    assert found.log_likelihood == pytest.approx(-0.5 * dense.value)


def test_without_random_effects_the_covariance_is_that_of_least_squares() -> None:
    design = random_design("none")
    theta = random_theta(design)
    dense = Dense(design, theta)
    expected = np.linalg.inv(dense.F.T @ np.linalg.solve(dense.V, dense.F))
    np.testing.assert_allclose(at(design, theta).covariance, expected, rtol=1e-9)


@pytest.mark.parametrize("groups", list(GROUPS))
def test_freedom_is_by_derivatives_of_the_dense_variance(groups: str) -> None:
    design = random_design(groups)
    theta = random_theta(design)
    prior = Prior({"joint": 0.5}, instrument_freedom=7.0)
    found, dense = at(design, theta, prior), Dense(design, theta)
    direction = np.array([1.0, -2.0, 0.5])
    weights = least_squares_map(dense).T @ direction
    parts = theta * np.array([weights @ V @ weights for V in dense.parts])
    curvature = np.diag(penalty(design, prior, theta).information)
    spread = 2.0 * np.linalg.inv(dense.information + curvature)
    expected = 2.0 * (weights @ dense.V @ weights) ** 2 / (parts @ spread @ parts)
    assert found.freedom(direction) == pytest.approx(expected, rel=1e-8)


def test_freedom_of_noise_alone_is_that_of_the_residual() -> None:
    design = replace(random_design("none"), blocks=())
    design = replace(design, instrument_of_row=np.minimum(design.instrument_of_row, 0))
    found = Marginal.at(design, reml(design))
    assert found.freedom(np.ones(3)) == pytest.approx(len(design.live) - 3, rel=1e-3)
    assert design.freedom == len(design.live) - 3


def test_posterior_of_a_block_is_that_of_dense_matrices() -> None:
    design = random_design()
    theta = random_theta(design)
    found, dense = at(design, theta), Dense(design, theta)
    block = design.blocks[0]
    spread = theta[-1] * block.root @ block.root.T
    X = design.flat(block.columns)
    mean, covariance = found.posterior("free")
    expected = block.mean + spread @ X.T @ dense.P @ design.response
    np.testing.assert_allclose(mean, expected, rtol=1e-9)
    left = spread - spread @ X.T @ dense.P @ X @ spread
    np.testing.assert_allclose(covariance, left, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("groups", list(GROUPS))
def test_projected_products_are_those_of_dense_matrices(groups: str) -> None:
    design = random_design(groups)
    theta = random_theta(design)
    rows = np.random.default_rng(3).normal(size=(len(design.live), 4))
    shown = at(design, theta).projected(rows)
    expected = rows.T @ Dense(design, theta).P @ rows
    np.testing.assert_allclose(shown.T @ shown, expected, rtol=1e-9, atol=1e-11)


def candidate(seed: int, amplitude: float | None, mean: float = 0.0) -> GaussianBlock:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(POSES, ROWS, 3))
    return GaussianBlock("new", columns, rng.normal(size=(3, 2)), np.full(3, mean), amplitude)


@pytest.mark.parametrize("mean", [0.0, 0.3])
@pytest.mark.parametrize("groups", list(GROUPS))
def test_evidence_is_the_gain_of_the_dense_likelihood(groups: str, mean: float) -> None:
    design = random_design(groups)
    theta = random_theta(design)
    without = Dense(design, theta).value
    block = candidate(1, 0.8, mean)
    wider = replace(design, blocks=(*design.blocks, block))
    found = at(design, theta).evidence(block)
    assert found.gain == pytest.approx(without - Dense(wider, theta).value, rel=1e-9, abs=1e-9)
    assert found.directions == 2
    assert found.amplitude == 0.8


def test_best_amplitude_is_that_of_the_dense_likelihood() -> None:
    design = random_design()
    theta = random_theta(design)
    block = candidate(1, None)
    truth = with_signal(design, block, 3.0)
    found = at(truth, theta).evidence(block)

    def value(log: float) -> float:
        own = replace(block, amplitude=float(np.exp(log)))
        return Dense(replace(truth, blocks=(*truth.blocks, own)), theta).value

    best = minimize_scalar(value, bounds=(-5.0, 5.0), method="bounded", options={"xatol": 1e-7})
    assert found.amplitude == pytest.approx(np.exp(best.x), rel=1e-4)
    assert found.gain == pytest.approx(Dense(truth, theta).value - best.fun, rel=1e-7)
    assert found.p < 1e-3


def with_signal(design: Design, block: GaussianBlock, size: float) -> Design:
    c = size * block.root @ np.ones(block.root.shape[1])
    return replace(design, r=design.r + block.columns @ c)


def test_columns_of_the_model_are_no_evidence() -> None:
    design = random_design()
    block = GaussianBlock("again", design.J[..., :2], np.eye(2), np.zeros(2), None)
    found = at(design, random_theta(design)).evidence(block)
    assert (found.gain, found.directions, found.p) == (0.0, 0, 1.0)


def test_evidence_depends_on_no_unit_of_rows_or_coefficients() -> None:
    design = random_design()
    theta = random_theta(design)
    block = candidate(1, None)
    truth = with_signal(design, block, 1.0)
    one = at(truth, theta).evidence(block)
    smaller = replace(block, columns=1e6 * block.columns, root=1e-6 * block.root)
    other = at(truth, theta).evidence(smaller)
    assert other.gain == pytest.approx(one.gain)
    assert other.amplitude == pytest.approx(one.amplitude)
    assert other.p == pytest.approx(one.p)


def test_refound_evidence_is_the_gain_of_both_optima() -> None:
    design = replace(random_design(), blocks=())
    block = candidate(1, None)
    truth = with_signal(design, block, 1.0)
    variances = reml(truth)
    found = Marginal.at(truth, variances).evidence(block, refind=True)
    wider = replace(truth, blocks=(block,))
    both = reml(wider)
    gain = Marginal.at(wider, both).log_likelihood - Marginal.at(truth, variances).log_likelihood
    assert found.gain == pytest.approx(2.0 * gain, abs=1e-4)
    assert found.amplitude == pytest.approx(both.amplitudes[0], rel=1e-2)
    assert found.gain >= Marginal.at(truth, variances).evidence(block).gain - 1e-6


@pytest.mark.parametrize("root", [0.05, 1.0, 100.0])
def test_probabilities_are_uniform_where_the_block_is_absent(root: float) -> None:
    """Whatever the weights of the directions, the noise scale estimated."""
    design = replace(random_design(), blocks=())
    theta = random_theta(design)
    lower = np.linalg.cholesky(Dense(design, theta).V)
    rng = np.random.default_rng(4)
    block = replace(candidate(1, None), root=root * np.diag([1.0, 0.3, 0.1]))
    found = []
    for _ in range(300):
        r = np.zeros(design.r.size)
        weight = design.pose_weight[design.pose]
        r[design.live] = 5.0 * lower @ rng.normal(size=len(lower)) / weight
        found.append(at(replace(design, r=r.reshape(design.r.shape)), theta).evidence(block).p)
    assert kstest(found, "uniform").pvalue > 0.01


@pytest.mark.parametrize("groups", list(GROUPS))
def test_pose_statistics_are_those_of_a_prediction_by_the_others(groups: str) -> None:
    design = replace(random_design(groups), pose_weight=np.ones(POSES))
    theta = random_theta(design)
    statistic, rows = at(design, theta).pose_statistics()
    assert statistic[5] == rows[5] == 0
    dense = Dense(design, theta)
    for pose in (0, 3, 9):
        own = design.pose == pose
        P, y = dense.P, design.response
        left = np.linalg.solve(P[np.ix_(own, own)], (P @ y)[own])
        expected = left @ P[np.ix_(own, own)] @ left
        assert statistic[pose] == pytest.approx(expected, rel=1e-9)
        assert rows[pose] == own.sum()


def test_the_weight_of_a_pose_does_not_change_its_statistic() -> None:
    """It is that of the pose at weight one, so weights found from it settle."""
    design = random_design()
    theta = random_theta(design)
    light = replace(design, pose_weight=np.where(np.arange(POSES) == 9, 0.1, design.pose_weight))
    one, other = (at(d, theta).pose_statistics()[0][9] for d in (design, light))
    assert one == pytest.approx(other, rel=1e-9)
