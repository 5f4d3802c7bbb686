"""What one step of scoring promises is what a search finds, where the variances change little."""

from __future__ import annotations

import numpy as np
import pytest

from calib.scatter.blocks import Block
from calib.scatter.nearby import NearbyLikelihood
from calib.scatter.restricted import Turned, maximised

B, D = 200, 6  # configurations, rows of each


def problem(rng: np.random.Generator, size: float) -> Turned:
    """Configurations that scatter along one direction each, and a suspect that is there by so much."""
    Z = rng.normal(size=(B, D, 1))
    known, suspect = rng.normal(size=(2, B, D, 1))
    y = rng.normal(size=(B, D, 1)) + Z * 2.0 * rng.normal(size=(B, 1, 1)) + size * suspect
    F = np.concatenate([known, suspect, y], axis=-1)
    none, one = np.zeros((0, 3)), (B, 1, D)  # approaches of each
    own, F = Z.reshape(*one, 1), F.reshape(*one, 3)
    block = Block(own, own[..., :0], np.array([1]), np.zeros(0, dtype=int), F)
    return Turned((block,), none, none, 1, 0, 0, np.ones(2))


@pytest.mark.parametrize("size", [0.0, 0.2, 0.6])
def test_the_promise_is_nearly_the_gain_and_never_more(
    rng: np.random.Generator, size: float
) -> None:
    whole, free = problem(rng, size), np.array([0, 1])
    alone = whole.with_columns(np.array([0, 2]), 1)
    theta, before = maximised(alone, np.array([1.0, 1.0]), free, 1e-9)
    prior = np.array([[1e-3]])
    held = whole.with_columns(np.arange(3), 1, np.array([[0.0, 1e-3, 0.0]]))
    _, after = maximised(held, theta, free, 1e-9)
    gain = NearbyLikelihood(whole, theta, free).gain(np.array([1]), prior)
    exact = before.value - after.value
    assert gain.fall + gain.promised <= exact + 1e-6
    assert gain.fall + gain.promised == pytest.approx(exact, rel=0.05, abs=0.05)
    assert gain.fall < exact or size == 0.0
