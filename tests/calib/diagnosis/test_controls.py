"""What must not be found: effects of shuffled columns, noise that grows where it is even."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Measurements
from calib.identification.noise_level import growth_with_range
from tests.calib.diagnosis.test_diagnose import DRIFT, diagnosed, measured

OF_THE_COLUMNS = ("time", "temperature", "approach", "motion")


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("base_drift:base", DRIFT),
        ("thermal_expansion:arm", (30e-6,)),
        ("backlash:A3", (80e-6,)),
    ],
)
def test_shuffled_columns_explain_nothing(effect: str, values: tuple[float, ...]) -> None:
    """With the true order the effect is found by its name; with a random one no such effect is."""
    found = diagnosed(effect, values, 8)
    assert effect in [f"{c.effect.kind}:{c.where}" for c, _ in found.causes[0].named.members]
    if effect != "backlash:A3":  # predicted from the rest of the session, in order of time
        assert found.gap.over_time is not None
        before, after = found.gap.over_time
        assert after < 0.8 * before
    cell, data, held = measured(effect, list(values), seed=8)
    control = calib.diagnose(cell, _shuffled(data, 1), heldout=_shuffled(held, 2))
    assert not [p for p in control.located if p.depends_on.split(":")[0] in OF_THE_COLUMNS]


def _shuffled(data: Measurements, seed: int) -> Measurements:
    """Time, temperature, approach and motion each dealt anew between the poses."""
    rng, poses = np.random.default_rng(seed), data.poses
    dealt = {
        name: getattr(poses, name)[rng.permutation(len(poses))]
        for name in ("time", "temperature", "approach", "motion")
    }
    return replace(data, poses=replace(poses, **dealt))


def test_noise_that_grows_with_range_is_seen_and_even_noise_is_not() -> None:
    _, data, _ = measured("", [])
    rng, ranges = np.random.default_rng(0), np.linalg.norm(data.points, axis=-1)
    sigma = 0.5 + (ranges - ranges.min()) / np.ptp(ranges) * 1.5
    r = rng.normal(size=(*data.seen.shape, 3)) * sigma[..., None]
    lengths = np.ones(data.seen.shape[1], dtype=bool)
    grows = growth_with_range(data, r.reshape(len(data), -1), lengths)
    assert grows is not None
    assert grows.farthest / grows.nearest == pytest.approx(4.0, rel=0.4)
    assert np.corrcoef(grows.relative.ravel(), sigma.ravel())[0, 1] > 0.95
    even = [
        growth_with_range(data, rng.normal(size=(len(data), data.seen.shape[1] * 3)), lengths)
        for _ in range(100)
    ]
    assert sum(g is not None for g in even) <= 2
    assert growth_with_range(data, r.reshape(len(data), -1), ~lengths) is None, "pixels have none"
