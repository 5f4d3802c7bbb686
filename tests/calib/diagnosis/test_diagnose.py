"""Causes found in simulated measurements, and none where there is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from studies.demo.embedded import embedded_cell
from tests.helpers import read_by, with_effects

MODEL = ("base", "tool", "geometry", "joint_compliance:A2,A3,A4,A5,A6")
CONFIGURATIONS = 30
DRIFT = (60e-6 / 3600, 0.0, 0.0, 0.0, 60e-6 / 3600, 0.0)


def session(rng: np.random.Generator, cell: Cell, count: int) -> calib.Poses:
    """Configurations, free and loaded, in the order of measurement."""
    low, high = cell.robot.sample_limits().T
    q = np.repeat(rng.uniform(low, high, (count, 6)), 2, axis=0)
    load = np.tile([0.0, 200.0], count)
    return with_moves(
        poses_at(
            q,
            time=np.arange(2.0 * count) * 60.0,
            temperature=20.0 + 3.0 * np.sin(np.arange(2.0 * count) / 9.0),
            load_mass=load,
            load_com=np.array([0.3, 0.0, 0.15]),
        )
    )


def measured(
    effect: str, values: list[float], seed: int = 0, twice: int = 0
) -> tuple[Cell, Measurements, Measurements]:
    """Readings of the embedded robot with one effect more than its model, and others held out.

    twice : int, of the first poses that are read two times
    """
    rng = np.random.default_rng(seed)
    cell = replace(with_effects(embedded_cell(), *MODEL), load=None)
    poses = session(rng, cell, CONFIGURATIONS + 10)
    true = with_effects(cell, *MODEL, *([effect] if effect else []))
    model = build(true, poses).model
    truth = np.zeros(len(model.parameters))
    for i, p in enumerate(model.parameters):
        if p.effect == "geometry":
            truth[i] = rng.normal() * 3e-4
        elif p.effect == "joint_compliance":
            truth[i] = rng.uniform(0.3, 3.0) * 1e-6
    own = [i for i, p in enumerate(model.parameters) if p.effect == effect.split(":")[0]]
    truth[own] = values
    index = np.sort(np.concatenate([np.arange(len(poses)), np.arange(twice)]))
    names = tuple(f"r{i:03d}" for i in range(len(index)))
    data = drawn_readings(model, truth, replace(poses.take(index), names=names), cell.noise, rng)
    kept = index < 2 * CONFIGURATIONS
    return cell, data.take(kept), data.take(~kept)


@cache
def diagnosed(effect: str, values: tuple[float, ...], seed: int) -> calib.Diagnosis:
    """What is found in such readings, once for all tests that ask about them."""
    cell, data, held = measured(effect, list(values), seed)
    return calib.diagnose(cell, data, heldout=held)


@pytest.mark.long
def test_nothing_is_found_where_nothing_is() -> None:
    for seed in range(3):
        cell, data, held = measured("", [], seed)
        found = calib.diagnose(cell, data, heldout=held)
        assert found.verdict == "no_gap"
        assert not found.causes
        assert not found.located
        assert found.gap.heldout_after == found.gap.heldout_before


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("backlash:A3", (60e-6,)),
        ("transmission_harmonic:A4", (150e-6, -100e-6, 0.0, 0.0)),
        ("bearing_compliance:A3", (40e-9,)),
        ("thermal_expansion:arm", (12e-6,)),
        ("joint_compliance:A1", (3e-6,)),
    ],
)
def test_a_cause_is_named_and_measured(effect: str, values: tuple[float, ...]) -> None:
    found = diagnosed(effect, values, 5)
    if effect == "joint_compliance:A1":
        # A vertical load does not turn A1: this one cannot be seen, and is said so.
        assert found.verdict == "no_gap"
        hidden = {(h.effect, h.where): h.smallest for h in found.hidden}
        assert hidden["joint_compliance", "A1"] == np.inf
        return
    kind, where = effect.split(":")
    members = [(c.effect.kind, c.where) for cause in found.causes for c, _ in cause.named.members]
    assert (kind, where) in members
    assert found.verdict in ("explained", "ambiguous")
    assert found.located[0].where == where
    assert found.gap.heldout_after is not None
    assert found.gap.heldout_after < 1.25 * found.gap.floor
    assert found.gap.closed is not None
    assert found.gap.closed > 0.8
    cause = next(c for c in found.causes if c.where == where)
    assert cause.name in repr(found)
    assert len(repr(found).splitlines()) <= 20
    if cause.name == kind:
        error = (cause.values - values) / cause.std
        assert np.abs(error).max() < 4.5


@pytest.mark.long
def test_a_cause_outside_the_catalogue_is_located() -> None:
    """A5 off by a step in its own angle: no name for it."""
    cell, data, held = measured("", [], seed=2)
    model = build(cell, data.poses).model

    def shifted(part: Measurements) -> Measurements:
        off = np.zeros_like(part.poses.q)
        off[:, 4] = 3e-4 * np.tanh(4.0 * part.poses.q[:, 4])
        bent = replace(part.poses, q=part.poses.q + off)
        change = model.predict(np.zeros(len(model.parameters)), bent) - model.predict(
            np.zeros(len(model.parameters)), part.poses
        )
        return replace(part, readings=part.points + change)

    found = calib.diagnose(cell, shifted(data), heldout=shifted(held))
    assert found.verdict == "unknown"
    assert (found.located[0].where, found.located[0].depends_on) == ("A5", "q:A5")
    assert not [c for c in found.causes if c.named.candidate.where != "A5"]


def test_gross_outliers_are_no_effect() -> None:
    cell, data, held = measured("", [], seed=3)
    points = data.points.copy()
    points[[7, 22]] += np.array([0.4e-3, -0.3e-3, 0.2e-3])
    found = calib.diagnose(cell, replace(data, readings=points), heldout=held)
    assert found.verdict == "no_gap"
    assert list(np.flatnonzero(found.outlier)) == [7, 22]


@pytest.mark.parametrize("repeats", [0, 2], ids=["single readings", "some repeated"])
def test_noise_larger_than_stated_is_no_effect(repeats: int) -> None:
    cell, data, held = measured("", [], seed=4, twice=repeats)
    optimist = replace(
        cell, instruments=read_by(type(cell.noise).isotropic(cell.noise.across / 1.5))
    )
    found = calib.diagnose(optimist, data, heldout=held)
    assert found.verdict == "no_gap"
    assert found.noise.sigma == pytest.approx(cell.noise.across, rel=0.1)


@pytest.mark.long
def test_lost_motion_at_every_joint_is_found_joint_by_joint() -> None:
    """Small at each, as no joint alone would be believed among all that is asked."""
    cell, data, held = measured("backlash", [3e-5] * 6)
    found = calib.diagnose(cell, data, heldout=held)
    named = {c.named.candidate.key for c in found.causes}
    assert len(named) >= 4
    assert named <= {f"backlash:A{k}" for k in range(1, 7)}
