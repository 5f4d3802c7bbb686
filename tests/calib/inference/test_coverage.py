"""Intervals by Satterthwaite's freedom cover the truth as often as they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from calib.inference import Design, Marginal, Prior
from calib.inference.reml import reml
from tests.calib.inference.designs import simple_design

_DAYS = 60
_LEVEL = 0.95


def day(places: int, approaches: int, seed: int) -> Design:
    """Nine rows a pose, four effects at approaches, the same at places where these come again."""
    rng = np.random.default_rng(seed)
    m = places * approaches
    place = np.arange(m) // approaches
    at_place = rng.normal(size=(places, 9, 8))[place]
    levers = at_place[..., :2]
    J = np.concatenate([at_place[..., 2:], 0.7 * at_place[..., :1] + 0.7], axis=-1)
    design = simple_design(levers, np.arange(m), J, np.zeros((m, 9)))
    effects = [replace(design.effects[0], levers=levers[..., j : j + 1]) for j in range(2)]
    if approaches > 1:
        effects += [replace(e, name="place", group=place) for e in effects]
    return replace(design, effects=tuple(effects))


@pytest.mark.long
@pytest.mark.parametrize("scatter", [0.0, 0.5, 2.0])
@pytest.mark.parametrize(("places", "approaches"), [(12, 1), (30, 1), (10, 2)])
def test_intervals_cover(places: int, approaches: int, scatter: float) -> None:
    design = day(places, approaches, 1)
    prior = Prior({"joint": 0.5})
    rng = np.random.default_rng(places + approaches)
    covered = []
    for _ in range(_DAYS):
        r = rng.normal(size=design.r.shape)
        for effect in design.effects:
            draws = rng.normal(size=(effect.group.max() + 1, 1)) * scatter
            r = r + (effect.levers @ draws[effect.group][..., None])[..., 0]
        own = replace(design, r=r)
        found = Marginal.at(own, reml(own, prior), prior)
        for direction in np.eye(7)[[0, 6]]:
            std = float(direction @ found.covariance @ direction) ** 0.5
            factor = stdtrit(found.freedom(direction), 0.5 + _LEVEL / 2.0)
            covered.append(abs(direction @ found.estimate) < factor * std)
    share = float(np.mean(covered))
    assert 0.92 < share < 0.985
