"""Sizes of errors: where the likelihood is largest, what they bring, and that many poses need none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.arrays import Array
from calib.errors import UnknownEffect
from calib.inference import widths as sizes
from calib.inference.widths import Elementary, widths_of
from calib.model.build import build
from calib.model.sizes import elementary, stated
from calib.noise import Noise
from calib.poses import poses_at
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot

RIGID = ("base", "tool", "geometry")


def problem(seed: int, rows: int, errors: int, width: float) -> tuple[Elementary, Array, Array]:
    """Two classes at four places, errors of a width, and rows that tell them with unit noise."""
    rng = np.random.default_rng(seed)
    k = errors // 2
    G = rng.normal(size=(k, errors))
    of_class, of_place = np.arange(errors) % 2, np.arange(errors) // 2 % 4
    of = Elementary(
        tuple(("geometry", f"j{i}", "x") for i in range(k)),
        np.arange(k),
        G,
        np.full(errors, 1.0),
        (("geometry", "um"), ("geometry", "urad")),
        np.ones(2),
        of_class,
        of_place,
    )
    J = rng.normal(size=(rows, k)) * 0.3
    return of, J, J @ G @ rng.normal(size=errors) * width + rng.normal(size=rows)


def objective(of: Elementary, J: Array, y: Array, at: Array) -> float:
    """-2 log of likelihood and of what is known beforehand, by the covariance of all rows in full.

    at : logarithms of the widths of two classes, of the shares of four places, and of the noise
    """
    widths, shares, noise = np.exp(at[:2]), np.exp(at[2:6]), float(np.exp(at[6]))
    D = widths[of.of_class] ** 2 / shares[of.of_place]
    V = noise**2 * np.eye(len(y)) + J @ (of.G * D) @ of.G.T @ J.T
    value = np.linalg.slogdet(V)[1] + y @ np.linalg.solve(V, y)
    value += sizes._KNOWN * (np.log(widths**2) + 1.0 / widths**2).sum()
    value += sizes._TAIL * (shares - np.log(shares)).sum()
    return float(value + sizes._STATED * (np.log(noise**2) + 1.0 / noise**2))


@pytest.mark.parametrize("seed", range(3))
def test_the_widths_are_where_the_likelihood_is_largest(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stationary in widths, shares and noise together, by a covariance that nothing factorises."""
    monkeypatch.setattr(sizes, "_SETTLED", 1e-10)
    monkeypatch.setattr(sizes, "_MOST_ROUNDS", 20_000)
    of, J, y = problem(seed, 30, 24, 2.0)
    found = widths_of(of, J, y, len(y))
    D = found.variances
    share = np.array([(found.widths[of.of_class] ** 2 / D)[of.of_place == g][0] for g in range(4)])
    at = np.log(np.concatenate([found.widths, share, [found.noise]]))
    steps = 1e-5 * np.eye(7)
    slope = [objective(of, J, y, at + s) - objective(of, J, y, at - s) for s in steps]
    np.testing.assert_allclose(np.array(slope) / 2e-5, 0.0, atol=2e-3)
    worse = [objective(of, J, y, at + s * 3e4) for s in (*steps, *-steps)]
    assert min(worse) > objective(of, J, y, at)


def test_an_error_of_thousands_of_plausible_sizes_is_met() -> None:
    """Its width has two modes; a search from the plausible size ends in the one beside that."""
    of, J, y = problem(0, 200, 24, 1.0)
    rng = np.random.default_rng(1)
    lone = replace(
        of,
        keys=(*of.keys, ("base_compliance", "base", "tilt")),
        at=np.arange(len(of.at) + 1),
        G=np.block([[of.G, np.zeros((len(of.G), 1))], [np.zeros((1, 24)), np.eye(1)]]),
        sizes=np.ones(25),
        classes=(*of.classes, ("base_compliance", "urad/(N m)")),
        scales=np.ones(3),
        of_class=np.append(of.of_class, 2),
        of_place=np.append(of.of_place, 4),
    )
    told = rng.normal(size=len(y)) / np.sqrt(len(y)) / 300.0  # to so many plausible sizes
    found = widths_of(lone, np.column_stack([J, told]), y + 4000.0 * told, len(y))
    assert 1000.0 < np.sqrt(found.variances[-1]) < 10_000.0


def test_widths_follow_the_errors() -> None:
    """Errors ten times as large have ten times the width, and what many rows tell needs no prior."""
    drawn = {w: [problem(seed, 40, 24, w) for seed in range(20)] for w in (4.0, 40.0)}
    small, large = (
        np.median([widths_of(*p, len(p[2])).widths for p in drawn[w]], axis=0) for w in drawn
    )
    np.testing.assert_allclose(large / small, 10.0, rtol=0.25)
    weak, strong = problem(0, 40, 24, 1.0), problem(0, 4000, 24, 10.0)
    assert widths_of(*weak, len(weak[2])).shows
    assert not widths_of(*strong, len(strong[2])).shows


def arm(seed: int, markers: int = 1) -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return cell_of(random_robot(rng, 6), rng.uniform(-0.1, 0.1, (markers, 3)), RIGID), rng


def test_parameters_spread_as_the_errors_that_they_stand_for() -> None:
    """Six constants at every frame, drawn alike: the irreducible ones predict the same points."""
    cell, rng = arm(0)
    built = build(cell)
    of = elementary(built.model, built.full)
    own, full = of.at, built.full.where(type(built.full.effects[-1]))
    poses = poses_at(rng.uniform(*cell.robot.sample_limits().T, (60, 6)))
    small = 1e-5 * rng.normal(size=of.G.shape[1])
    every = built.full.initial
    every[full] = small
    points = built.full.predict(every, poses)
    values = built.model.initial
    values[own] = of.G @ small
    _, J = built.model.jacobian(values, poses)
    off = (points - built.model.predict(values, poses)).ravel()
    places = np.delete(J.reshape(len(off), -1), own, axis=1)
    left = off - places @ np.linalg.lstsq(places, off, rcond=None)[0]
    assert np.abs(left).max() < 0.02 * np.abs(points - built.full.predict(0 * every, poses)).max()


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_few_poses_predict_better_with_sizes(scale: float) -> None:
    """Thirteen poses of one marker for some 33 parameters, over arms, by a coarse instrument."""
    ratios = []
    for seed in range(8):
        cell, rng = arm(seed)
        built = build(cell)
        of = elementary(built.model, built.full)
        values = built.model.initial
        values[of.at] = of.G @ (scale * 5e-4 * rng.normal(size=of.G.shape[1]))
        q = rng.uniform(*cell.robot.sample_limits().T, (60, 6))
        data = drawn_readings(built.model, values, poses_at(q), Noise.isotropic(2e-4), rng)
        few, held = data.take(slice(0, 13)), data.take(slice(20, 60))
        by = {
            prior: calib.identify(replace(cell, size_prior=prior), few, heldout=held).rms("heldout")
            for prior in ("estimated", "off")
        }
        ratios.append((by["estimated"] or 0.0) / (by["off"] or 1.0))
    assert np.median(ratios) < 1.02
    assert np.exp(np.mean(np.log(ratios))) < 1.005


def test_many_poses_decide_alone() -> None:
    cell, rng = arm(3, 3)
    model = build(cell).model
    q = rng.uniform(*cell.robot.sample_limits().T, (80, 6))
    truth = model.initial + 1e-3 * rng.normal(size=len(model.parameters))
    data = drawn_readings(model, truth, poses_at(q), cell.noise, rng)
    found, alone = (calib.identify(replace(cell, size_prior=p), data) for p in ("estimated", "off"))
    assert found.sizes is None
    np.testing.assert_array_equal(found.values, alone.values)


@pytest.mark.long
def test_stated_widths_are_a_prior_of_plans_too() -> None:
    cell, _ = arm(1, 3)
    told = replace(cell, size_prior={"geometry_mrad": 1e-3, "geometry_mm": 1e-3})
    free, held = (doe.design(c, criterion="D", poses=12, candidates=200) for c in (cell, told))
    own = [p.effect == "geometry" for p in held.problem.model.parameters]
    assert (held.assessment.std[own] < 5e-6).all()
    assert free.assessment.std[own].max() > 1e-5


@pytest.mark.parametrize(
    ("widths", "said"),
    [
        ({"geometry_deg": 1.0}, "geometry_deg.*geometry_mm"),
        ({"backlash_mrad": 1.0}, "backlash_mrad.*may have"),
    ],
)
def test_a_width_of_nothing_is_named(widths: dict[str, float], said: str) -> None:
    cell, _ = arm(1)
    with pytest.raises(UnknownEffect, match=said):
        build(replace(cell, size_prior=widths))


def test_zeros_may_have_a_width_of_their_own(kr270: Cell) -> None:
    built = build(replace(kr270, effects=RIGID))
    of = elementary(built.model, built.full)
    widths = {"geometry_mrad": 2.0, "geometry_mm": 3.0}
    alike, apart = stated(of, widths), stated(of, widths | {"joint_offset_mrad": 20.0})
    assert alike.keys == apart.keys
    assert (apart.std >= alike.std * (1.0 - 1e-9)).all()
    assert (apart.std > 2.0 * alike.std).any()


@pytest.fixture(scope="module")
def tiago(data: Path) -> tuple[Cell, Any, Any]:
    cell = calib.load_cell(data / "tiago" / "cell.toml")
    tables = ("measurements.csv", "validation.csv")
    return (cell, *(calib.load_measurements(cell, data / "tiago" / name) for name in tables))


def test_tiago_is_predicted_better(tiago: tuple[Cell, Any, Any]) -> None:
    """Its 37 postures of one marker: 4.18 mm on another day without sizes."""
    cell, data, other = tiago
    found = calib.identify(cell, data, heldout=other)
    assert (found.rms("heldout") or 1.0) < 3.35e-3
    off = calib.identify(replace(cell, size_prior="off"), data, heldout=other)
    assert 4.1e-3 < (off.rms("heldout") or 0.0) < 4.25e-3


def test_the_joint_that_is_worn_is_named_whatever_its_size(tiago: tuple[Cell, Any, Any]) -> None:
    """By the side from which it came or by the last move: 37 postures tell both from nothing."""
    cell, data, other = tiago
    found = calib.diagnose(cell, data, heldout=other)
    named = {c.named.candidate.key: c for c in found.causes if c.probability > 0.8}
    assert named
    assert named.keys() <= {"backlash:arm_6_joint", "settling:arm_6_joint"}
    largest = max(abs(float(c.values[0])) for c in named.values())
    assert 8e-3 < largest < 30e-3
    assert (found.gap.heldout_after or 1.0) < 2.2e-3


@pytest.mark.long
def test_a_base_that_yields_is_named_on_a_column(data: Path) -> None:
    """The ground under a construction robot, by a seesaw: 24.7 urad/(N m) by a fit that was told.

    Every other reading is enough. Masses of links, and a curve over the same load, may take a third of
    it: the form is doubted, and said to be.
    """
    cell = calib.load_cell(data / "hilti_column" / "cell.toml")
    whole = calib.load_measurements(cell, data / "hilti_column" / "seesaw.csv")
    kept, held = whole.take(slice(None, None, 2)).split(0.3, np.random.default_rng(0))
    found = calib.diagnose(cell, kept, heldout=held)
    named = {c.named.candidate.key: c for c in found.causes}
    assert 15e-6 < float(named["base_compliance:base"].values[0]) < 28e-6
    assert named["base_compliance:base"].standing == "likely"
    assert (found.gap.heldout_after or 1.0) < 2.5e-3
