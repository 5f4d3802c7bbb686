"""Gross errors lose their weight, clean poses keep theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.inference import Design, Marginal, Prior, pose_weights, robust_reml
from calib.inference.reml import reml
from tests.calib.inference.designs import simple_design

PRIOR = Prior({"joint": 1.0})


def clean(poses: int = 60, seed: int = 0, scatter: float = 0.5) -> Design:
    rng = np.random.default_rng(seed)
    levers = rng.normal(size=(poses, 9, 2))
    J = rng.normal(size=(poses, 9, 5))
    moved = (levers @ (scatter * rng.normal(size=(poses, 2, 1))))[..., 0]
    return simple_design(levers, np.arange(poses), J, moved + rng.normal(size=(poses, 9)))


def spoiled(design: Design, bad: list[int], size: float) -> Design:
    r = design.r.copy()
    r[bad] += size * np.random.default_rng(1).normal(size=r[bad].shape)
    return replace(design, r=r)


def test_clean_poses_keep_their_weight() -> None:
    design, variances = robust_reml(clean(), PRIOR)
    assert (design.pose_weight == 1.0).mean() > 0.95
    plain = reml(clean(), PRIOR)
    np.testing.assert_allclose(variances.instrument, plain.instrument, rtol=0.05)


@pytest.mark.parametrize("size", [10.0, 1e4])
def test_gross_errors_lose_theirs(size: float) -> None:
    """Estimate and variances are nearly those without the poses."""
    bad = [3, 20, 41]
    design, variances = robust_reml(spoiled(clean(), bad, size), PRIOR)
    light = design.pose_weight < 0.6
    assert light[bad].all()
    assert light.sum() <= 5
    rest = np.ones(60)
    rest[bad] = 0.0
    without = replace(clean(), pose_weight=rest)
    truth = reml(without, PRIOR)
    np.testing.assert_allclose(variances.instrument, truth.instrument, rtol=0.05)
    off = Marginal.at(design, variances).estimate - Marginal.at(without, truth).estimate
    std = np.sqrt(np.diag(Marginal.at(without, truth).covariance))
    assert (np.abs(off) < 0.5 * std).all()


def test_weights_fall_with_the_statistic_and_never_to_nothing() -> None:
    rows = np.full(20, 9)
    statistic = np.append(np.linspace(4.0, 12.0, 16), [20.0, 40.0, 100.0, 1e8])
    weight = pose_weights(statistic, rows)
    assert (weight[:17] == 1.0).all()
    assert (np.diff(weight[16:]) < 0.0).all()
    assert weight[-1] > 0.0
    np.testing.assert_allclose(pose_weights(7.0 * statistic, rows), weight)


def test_dropped_poses_stay_out() -> None:
    design = clean()
    weight = np.where(np.arange(60) == 7, 0.0, 1.0)
    assert robust_reml(replace(design, pose_weight=weight), PRIOR)[0].pose_weight[7] == 0.0
