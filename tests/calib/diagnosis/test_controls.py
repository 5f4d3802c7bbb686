"""What must not be found: effects of shuffled columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Measurements
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
