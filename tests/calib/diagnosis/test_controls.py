"""What must not be found: effects of shuffled columns, wrong shapes where they are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Measurements
from calib.build import build
from calib.diagnosis.candidates import candidates
from calib.diagnosis.range_noise import growth
from calib.diagnosis.shape import shape_doubt
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.identify.identify import whitening
from calib.identify.initial import initial_values
from calib.model import Model
from calib.se3 import Array
from tests.calib.diagnosis.test_diagnose import measured

OF_THE_COLUMNS = ("time", "temperature", "approach", "motion")


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("base_drift:base", [60e-6 / 3600, 0.0, 0.0, 0.0, 60e-6 / 3600, 0.0]),
        ("thermal_expansion:arm", [30e-6]),
        ("backlash:A3", [80e-6]),
    ],
)
def test_shuffled_columns_explain_nothing(effect: str, values: list[float]) -> None:
    """With the true order the effect is found by its name; with a random one no such effect is."""
    cell, data, held = measured(effect, values, seed=8)
    found = calib.diagnose(cell, data, heldout=held)
    assert effect in [f"{c.effect.kind}:{c.where}" for c, _ in found.causes[0].named.members]
    if effect != "backlash:A3":  # predicted from the rest of the session, in order of time
        assert found.gap.over_time is not None
        before, after = found.gap.over_time
        assert after < 0.8 * before
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


def _fitted(effect: str, values: list[float], seed: int, bent: float) -> tuple[Fit, Measurements]:
    """The right effect fitted to readings in which its size varies with twice A3's angle."""
    cell, data, _ = measured(effect, values, seed=seed)
    nominal = build(cell, data.poses).model
    start = initial_values(nominal, data)
    stage = Stage(
        data, nominal, start, whitening(cell, nominal, start, data), np.zeros(len(data), dtype=bool)
    )
    placed = _placed(cell, data, effect)
    if bent:
        done = stage.fit([placed])
        own = done.positions(placed)
        moved = _moved(done.model, data, own, np.array(values))
        factor = bent * np.sin(2.0 * data.poses.q[:, 2] + 0.7)
        data = replace(data, points=data.points + moved * factor[:, None, None])
        stage = replace(stage, data=data)
    return stage.fit([placed]), data


def _placed(cell: calib.Cell, data: Measurements, effect: str) -> Effect:
    suspects, _ = candidates(cell, build(cell, data.poses).model, data)
    return next(c.effect for c in suspects if c.key == effect)


def _moved(model: Model, data: Measurements, own: Array, values: Array) -> Array:
    zero = np.zeros(len(model.parameters))
    zero[: len(zero) - len(own)] = initial_values(model, data)[: len(zero) - len(own)]
    with_it = zero.copy()
    with_it[own] = values
    return model.predict(with_it, data.poses) - model.predict(zero, data.poses)


def test_a_right_shape_is_seldom_doubted_and_a_wrong_one_is() -> None:
    right, wrong = [], []
    for seed in range(12):
        for bent, found in ((0.0, right), (0.35, wrong)):
            fit, data = _fitted("backlash:A3", [120e-6], seed, bent)
            doubt = shape_doubt(fit.model.robot, data.poses, fit, fit.model.effects[-1])
            found.append((doubt.p, doubt.joint))
    assert np.mean([p < 0.1 for p, _ in right]) <= 0.34  # 12 draws of a chance of a tenth
    assert np.mean([p < 0.1 for p, _ in wrong]) >= 0.9
    assert {joint for p, joint in wrong if p < 1e-4} == {"A3"}


def test_noise_that_grows_with_range_is_seen_and_even_noise_is_not() -> None:
    _, data, _ = measured("", [])
    rng, ranges = np.random.default_rng(0), np.linalg.norm(data.points, axis=-1)
    sigma = 0.5 + (ranges - ranges.min()) / np.ptp(ranges) * 1.5
    r = rng.normal(size=(*data.seen.shape, 3)) * sigma[..., None]
    grows = growth(data, r.reshape(len(data), -1))
    assert grows is not None
    assert grows.farthest / grows.nearest == pytest.approx(4.0, rel=0.4)
    assert np.corrcoef(grows.relative.ravel(), sigma.ravel())[0, 1] > 0.95
    even = [growth(data, rng.normal(size=(len(data), data.seen.shape[1] * 3))) for _ in range(100)]
    assert sum(g is not None for g in even) <= 2
