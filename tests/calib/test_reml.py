"""Variances: against MixedLM of statsmodels, at the maximum, at the boundary, from any start."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from calib.inference import Design, Marginal, Prior, Variances
from calib.inference.restricted import MixedModel, RestrictedLikelihood
from tests.calib.designs import (
    GROUPS,
    Dense,
    random_design,
    random_theta,
    simple_design,
)


def reml(design: Design, prior: Prior | None = None, start: Variances | None = None) -> Variances:
    return Marginal.fitted(design, prior, start).variances


def intercepts(seed: int, between: float, groups: int = 12, each: int = 4) -> Design:
    """A random intercept a group of poses with one row, and two fixed columns."""
    rng = np.random.default_rng(seed)
    m = groups * each
    J = np.stack([np.ones(m), rng.normal(size=m)], axis=-1)[:, None]
    group = np.arange(m) // each
    r = J @ np.array([1.0, -2.0]) + between * rng.normal(size=(groups, 1))[group]
    return simple_design(np.ones((m, 1, 1)), group, J, r + 0.5 * rng.normal(size=(m, 1)))


@pytest.mark.parametrize("seed", range(4))
def test_variances_value_and_deviations_are_those_of_statsmodels(seed: int) -> None:
    smf = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    design = intercepts(seed, 0.8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = smf.MixedLM(design.r[:, 0], design.J[:, 0], design.effects[0].group)
        peer = model.fit(reml=True, method="lbfgs", tol=1e-12)
    found = reml(design)
    assert found.instrument[0] == pytest.approx(peer.scale, rel=1e-3)
    assert found.effects[0] == pytest.approx(float(peer.cov_re[0, 0]), rel=2e-3)
    own = RestrictedLikelihood(MixedModel.of(design), design.theta(found))
    assert -0.5 * own.value == pytest.approx(peer.llf, abs=1e-5)
    np.testing.assert_allclose(own.coefficients, peer.fe_params, rtol=1e-4)
    np.testing.assert_allclose((own.inverse**2).sum(axis=1) ** 0.5, peer.bse_fe, rtol=0.02)


@pytest.mark.parametrize("prior", [Prior(), Prior({"joint": 0.3})])
@pytest.mark.parametrize("groups", list(GROUPS))
def test_no_variance_improves_the_penalised_likelihood(groups: str, prior: Prior) -> None:
    """Slopes vanish; where a variance is at its lower bound, it would only rise."""
    design = random_design(groups, 3)
    theta = design.theta(reml(design, prior))
    slope = RestrictedLikelihood(MixedModel.of(design), theta).derivatives[0]
    slope = slope + prior.penalty(design, theta).slope
    assert np.abs(slope).max() < 5e-3


@pytest.mark.parametrize("of_logarithm", [True, False])
def test_the_slope_of_a_prior_is_that_of_its_value(of_logarithm: bool) -> None:
    """Central differences by log variances."""
    design = random_design("places", 3)
    prior = Prior({"joint": 0.3}, of_logarithm=of_logarithm)
    theta = np.linspace(0.2, 1.5, len(design.theta(reml(design))))
    for j, slope in enumerate(prior.penalty(design, theta).slope):
        step = np.exp(1e-5 * (np.arange(len(theta)) == j))
        up, down = (prior.penalty(design, t).value for t in (theta * step, theta / step))
        assert slope == pytest.approx((up - down) / 2e-5, abs=1e-6)


@pytest.mark.parametrize("groups", list(GROUPS))
def test_any_start_leads_to_the_same_variances(groups: str) -> None:
    design = random_design(groups, 5)
    prior = Prior({"joint": 0.3})
    plain = design.theta(reml(design, prior))
    for seed in range(3):
        start = design.variances(random_theta(design, seed) * 10.0 ** (2 * seed - 2))
        found = design.theta(reml(design, prior, start))
        np.testing.assert_allclose(found, plain, rtol=5e-3, atol=1e-6)


def test_a_variance_that_is_not_there_goes_to_its_bound_and_not_below() -> None:
    """Groups that agree better than noise allows: nothing without a prior, little with one."""
    design = intercepts(1, 0.0)
    left = (design.r[:, 0] - design.J[:, 0] @ np.array([1.0, -2.0])).reshape(12, 4)
    left = (left - left.mean(axis=1, keepdims=True)).reshape(48)
    design = replace(design, r=left[:, None])
    noise = float(left.var())
    assert 0.0 < reml(design).effects[0] < 1e-5 * noise
    known = reml(design, Prior({"joint": 0.05})).effects[0]
    assert 1e-4 * noise < known < noise / 4.0


def test_where_rows_say_nothing_the_data_sheet_stands() -> None:
    """A lever too short to show beside the noise."""
    rng = np.random.default_rng(0)
    design = simple_design(
        1e-6 * rng.normal(size=(30, 3, 1)),
        np.arange(30),
        rng.normal(size=(30, 3, 2)),
        rng.normal(size=(30, 3)),
    )
    prior = Prior({"joint": 0.2})
    marginal = Marginal.fitted(design, prior)
    assert np.sqrt(marginal.variances.effects[0]) == pytest.approx(0.2, rel=0.02)
    assert marginal.log_covariance[1, 1] == pytest.approx(4.0, rel=0.02)


def test_units_scale_the_variances() -> None:
    design = random_design("approaches within places", 3)
    design = replace(design, blocks=design.blocks[:1])
    other = replace(
        design,
        r=1e-4 * design.r,
        J=1e2 * design.J,
        blocks=(replace(design.blocks[0], columns=1e-4 * design.blocks[0].columns),),
        effects=tuple(replace(e, levers=10.0 * e.levers) for e in design.effects),
    )
    one, two = reml(design), reml(other)
    np.testing.assert_allclose(two.instrument, 1e-8 * one.instrument, rtol=1e-3)
    noise = one.instrument.mean()
    np.testing.assert_allclose(1e10 * two.effects, one.effects, rtol=5e-3, atol=1e-5 * noise)
    np.testing.assert_allclose(two.amplitudes, one.amplitudes, rtol=5e-3, atol=1e-3)


def test_simulated_variances_are_found_on_average() -> None:
    """Three components over forty places, two approaches each."""
    rng = np.random.default_rng(1)
    m, rows = 80, 6
    levers = rng.normal(size=(m, rows, 2))
    design = simple_design(levers, np.arange(m), rng.normal(size=(m, rows, 3)), np.zeros((m, rows)))
    place = replace(design.effects[0], name="place", group=np.arange(m) // 2)
    design = replace(design, effects=(*design.effects, place))
    truth = np.array([0.25, 0.3, 0.8])
    found, spread = [], []
    for _ in range(30):
        own = rng.normal(size=(m, 2)) * 0.3**0.5
        own = own + (rng.normal(size=(m // 2, 2)) * 0.8**0.5)[place.group]
        r = (levers @ own[..., None])[..., 0] + 0.5 * rng.normal(size=(m, rows))
        drawn = Marginal.fitted(replace(design, r=r))
        found.append(design.theta(drawn.variances))
        spread.append(np.diag(drawn.log_covariance) ** 0.5)
    mean, std = np.mean(found, axis=0), np.std(found, axis=0) / 30**0.5
    assert (np.abs(mean - truth) < 3.5 * std).all()
    np.testing.assert_allclose(np.std(np.log(found), axis=0), np.mean(spread, axis=0), rtol=0.5)


def test_posterior_of_a_block_is_that_of_dense_matrices() -> None:
    design = random_design()
    theta = random_theta(design)
    found = Marginal.fitted(design).at(design.variances(theta))
    dense = Dense(design, theta)
    block = design.blocks[0]
    spread = theta[-1] * block.root @ block.root.T
    X = design.flat(block.columns)
    mean, covariance = found.posterior("free")
    expected = block.mean + spread @ X.T @ dense.P @ design.response
    np.testing.assert_allclose(mean, expected, rtol=1e-9)
    left = spread - spread @ X.T @ dense.P @ X @ spread
    np.testing.assert_allclose(covariance, left, rtol=1e-8, atol=1e-10)
