"""Sizes of errors: where the likelihood is largest, what they bring, and that they count once.

Whoever asks, estimates are those by hand, of an arm of plain numpy.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import calib
import doe
from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis import Diagnosis
from calib.errors import TooFewPoses, UnknownEffect
from calib.inference import widths as sizes
from calib.inference.widths import Elementary, Key, widths_of
from calib.model.build import build
from calib.model.sizes import elementary, stated
from calib.noise import Noise
from calib.simulation import drawn_readings
from tests import plain_day as days
from tests.day import RIGID, anywhere, erring
from tests.helpers import cell_of, random_robot


def problem(seed: int, rows: int, errors: int, width: float) -> tuple[Elementary, Array, Array]:
    """Two classes at four places, errors of a width, and rows that tell them with unit noise."""
    rng = np.random.default_rng(seed)
    k = errors // 2
    G = rng.normal(size=(k, errors))
    of_class, of_place = np.arange(errors) % 2, np.arange(errors) // 2 % 4
    keys = tuple(("geometry", f"j{i}", "x") for i in range(k))
    classes = (("geometry", "um"), ("geometry", "urad"))
    of = Elementary(
        keys, np.arange(k), G, np.full(errors, 1.0), classes, np.ones(2), of_class, of_place
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


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_the_widths_are_where_the_likelihood_is_largest(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stationary in widths, shares and noise together, by a covariance that nothing factorises."""
    monkeypatch.setattr(sizes, "_SETTLED", 1e-10)
    monkeypatch.setattr(sizes, "_MOST_ROUNDS", 20_000)
    of, J, y = problem(seed, 30, 24, 2.0)
    found = widths_of(of, J, y, len(y))
    share = found.widths[of.of_class] ** 2 / found.variances
    share = np.array([share[of.of_place == g][0] for g in range(4)])
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
        np.median([widths_of(*p, len(p[2])).widths for p in own], axis=0) for own in drawn.values()
    )
    np.testing.assert_allclose(large / small, 10.0, rtol=0.25)
    weak, strong = problem(0, 40, 24, 1.0), problem(0, 4000, 24, 10.0)
    assert widths_of(*weak, len(weak[2])).shows
    assert not widths_of(*strong, len(strong[2])).shows


# -- Arms whose geometry errs


def arm(seed: int, markers: int = 1) -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return cell_of(random_robot(rng, 6), rng.uniform(-0.1, 0.1, (markers, 3)), RIGID), rng


def test_parameters_spread_as_the_errors_that_they_stand_for() -> None:
    """Six constants at every frame, drawn alike: the irreducible ones predict the same points."""
    cell, rng = arm(0)
    built = build(cell)
    of = elementary(built.model, built.full)
    own, full = of.at, built.full.where(type(built.full.effects[-1]))
    poses = anywhere(cell, rng, 60)
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


@pytest.mark.parametrize("scale", [1.0, pytest.param(10.0, marks=pytest.mark.long)])
def test_few_poses_predict_better_with_sizes(scale: float) -> None:
    """Thirteen poses of one marker for some 33 parameters, over arms, by a coarse instrument."""
    ratios = []
    for seed in range(8):
        cell, rng = arm(seed)
        built = build(cell)
        of = elementary(built.model, built.full)
        values = built.model.initial
        values[of.at] = of.G @ (scale * 5e-4 * rng.normal(size=of.G.shape[1]))
        poses = anywhere(cell, rng, 60)
        data = drawn_readings(built.model, values, poses, Noise.isotropic(2e-4), rng)
        few, held = data.take(slice(0, 13)), data.take(slice(20, 60))
        by = [
            calib.identify(replace(cell, size_prior=prior), few, heldout=held).rms("heldout") or 0.0
            for prior in ("estimated", "off")
        ]
        ratios.append(by[0] / by[1])
    assert np.median(ratios) < 1.02
    assert np.exp(np.mean(np.log(ratios))) < 1.005


@pytest.mark.parametrize(
    ("prior", "fewest"),
    [("off", 9), ("estimated", 6), ({"geometry_mrad": 1.0, "geometry_mm": 1.0}, 3)],
)
def test_fewer_poses_will_do_where_sizes_are_known(prior: Any, fewest: int) -> None:
    """Three numbers a pose for nine of places and 18 of geometry, of which sizes tell half or all."""
    cell, rng = arm(0)
    cell = replace(cell, size_prior=prior)
    data, _ = erring(cell, anywhere(cell, rng, fewest), rng)
    assert (calib.identify(cell, data).rms("fitted") or 0.0) < 1e-5
    for verb in (calib.identify, calib.diagnose):
        with pytest.raises(TooFewPoses, match=f"measure at least {fewest} poses"):
            verb(cell, data.take(slice(1, None)))


def test_many_poses_decide_alone() -> None:
    cell, rng = arm(3, 3)
    model, poses = build(cell).model, anywhere(cell, rng, 80)
    truth = model.initial + 1e-3 * rng.normal(size=len(model.parameters))
    data = drawn_readings(model, truth, poses, cell.noise, rng)
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


def test_a_width_of_nothing_is_named() -> None:
    with pytest.raises(UnknownEffect, match=r"backlash_mrad.*may have"):
        build(replace(arm(1)[0], size_prior={"backlash_mrad": 1.0}))


def test_zeros_may_have_a_width_of_their_own(kr270: Cell) -> None:
    built = build(replace(kr270, effects=RIGID))
    of = elementary(built.model, built.full)
    widths = {"geometry_mrad": 2.0, "geometry_mm": 3.0}
    alike, apart = stated(of, widths), stated(of, widths | {"joint_offset_mrad": 20.0})
    assert alike.keys == apart.keys
    assert (apart.std >= alike.std * (1.0 - 1e-9)).all()
    assert (apart.std > 2.0 * alike.std).any()


# -- Real arms


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


@pytest.mark.long
def test_the_joint_that_is_worn_is_named_whatever_its_size(tiago: tuple[Cell, Any, Any]) -> None:
    """By the side from which it came or by the last move: 37 postures tell both from nothing."""
    cell, data, other = tiago
    found = calib.diagnose(cell, data, heldout=other)
    named = {c.named.candidate.key: c for c in found.causes if c.probability > 0.8}
    assert named
    assert named.keys() <= {"backlash:arm_6_joint", "settling:arm_6_joint"}
    assert 8e-3 < max(abs(float(c.values[0])) for c in named.values()) < 30e-3
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
    cause = {c.named.candidate.key: c for c in found.causes}["base_compliance:base"]
    assert 15e-6 < float(cause.values[0]) < 28e-6
    assert cause.standing == "likely"
    assert (found.gap.heldout_after or 1.0) < 2.5e-3


# -- What a cell says of sizes counts once: by Bayes' formula, of an arm of plain numpy

TRANSLATION, ROTATION = 5e-5, 1e-4  # m and rad, of each coordinate of a tip that scatters
ARM = "repeatability_mm = 0.05\nrepeatability_urad = 100"
EXACT = "repeatability_mm = 0"  # else scatter that the readings do not rule out would count
KEYS: tuple[Key, ...] = (
    ("backlash", "J2", "half_width"),
    ("joint_compliance", "J3", "compliance"),
    ("joint_offset", "J2", "offset"),
    ("thermal_expansion", "J2", "growth"),
)
STD = np.array([2e-5, 3e-7, 5e-5, 4e-6])
TRUTH = np.array([0.5, -0.5, 0.7, 0.5]) * STD
WIDTHS = {
    "backlash_urad": 20.0,
    "joint_compliance_urad_per_Nm": 0.3,
    "joint_offset_urad": 50.0,
    "thermal_expansion_um_per_mK": 4.0,
}
Given = dict[str, Array]


def points(given: Given, values: Array, markers: Array | None = None) -> Array:
    """values : of the keys, (4,), of the base and of the markers, (19,)"""
    gap, soft, offset, growth = (
        own * np.eye(5)[k] for own, k in zip(values[:4], (1, 2, 1, 1), strict=True)
    )
    own = days.MARKERS + values[10:].reshape(3, 3) if markers is None else markers
    return days.points(days.Errors(offset, soft, gap, growth, values[4:10], own), **given, mass=0.0)


def one_day(
    folder: Path, seed: int, loud: float = 1.0, scatters: bool = False, arm: str = ""
) -> tuple[Cell, Measurements, Given]:
    """A cell, what was read, and the arguments of ``days.points`` as they stand in the table.

    loud : of the noise over what the cell states; scatters : whether the tip comes elsewhere each time
    arm : lines of [robot]
    """
    rng, m = np.random.default_rng(seed), 30
    q = np.round(days.joints(m, rng), 9)
    wrench = np.round(rng.normal(size=(m, 6)) * np.repeat([150.0, 30.0], 3), 3)
    came, kelvin = rng.choice([-1.0, 1.0], q.shape), np.round(rng.uniform(-8.0, 8.0, m), 3)
    given = {"q": q, "wrench": wrench, "approach": came, "warming": kelvin}
    true = np.concatenate([TRUTH, days.BASE, np.zeros(9)])
    read = points(given, true)
    if scatters:
        moved, turned = rng.normal(size=(2, m, 1, 3))
        off = read - points(given, true, np.zeros((1, 3)))
        read += TRANSLATION * moved + ROTATION * np.cross(turned, off)
    read += loud * days.SIGMA * rng.normal(size=read.shape)
    columns = dict(zip(days.WRENCH, wrench.T, strict=True)) | {"temperature_degC": 20.0 + kelvin}
    columns |= {f"approach_J{k}": own for k, own in enumerate(came.T, 1)}
    kinds = ", ".join(['"base", "tool"', *(f'"{kind}:{where}"' for kind, where, _ in KEYS)])
    cell = calib.load_cell(days.write_cell(folder, kinds, arm, ""))
    (folder / "measurements.csv").write_text(days.table(q, read, columns))
    return cell, calib.load_measurements(cell, folder / "measurements.csv"), given


def by_hand(
    data: Measurements, given: Given, sigma: float, arm: bool = False
) -> tuple[Array, Array]:
    """Mean and standard deviations of the parameters but base and markers, (4,) each, by Bayes.

    arm : whether the tip comes elsewhere each time as ``ARM`` says, beside the noise of each point
    """
    scale = np.concatenate([STD, np.full(15, 1e-4)])
    start = np.concatenate([np.zeros(4), days.BASE, np.zeros(9)])
    d = points(given, start) - points(given, start, np.zeros((1, 3)))
    H = np.stack([np.cross(axis, d).reshape(len(d), 9) for axis in np.eye(3)], axis=-1)
    together = np.tile(np.eye(3), (3, 1))
    V = TRANSLATION**2 * together @ together.T + ROTATION**2 * H @ np.swapaxes(H, -1, -2)
    whiten = np.linalg.inv(np.linalg.cholesky(sigma**2 * np.eye(9) + arm * V))

    def off(x: Array) -> Array:
        r = (points(given, x * scale) - data.points).reshape(-1, 9, 1)
        return np.concatenate([(whiten @ r).ravel(), (x * scale)[:4] / STD])

    found = least_squares(off, start / scale, method="lm", diff_step=1e-5)
    return found.x[:4] * STD, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))[:4] * STD


def told(found: calib.Identification | Diagnosis) -> tuple[Array, Array]:
    """The same of a result."""
    fit = found.after if isinstance(found, Diagnosis) else found
    cov = fit.covariance * (found.scale**2 if isinstance(found, Diagnosis) else 1.0)
    at = [fit.model.keys.index(key) for key in KEYS]
    return fit.values[at], np.sqrt(np.diag(cov))[at]


def foreseen(cell: Cell, data: Measurements, found: calib.Identification) -> Array:
    return doe.enough(cell, data).steps[0].std[[found.model.keys.index(key) for key in KEYS]]


@pytest.mark.parametrize(
    ("loud", "arm"),
    [(1.0, EXACT), pytest.param(8.0, "", marks=pytest.mark.long), (1.0, ARM)],
    ids=["as stated", "loud", "an arm that scatters"],
)
def test_it_counts_as_by_hand(tmp_path: Path, loud: float, arm: str) -> None:
    """Under loads, with lost motion and heat: by either approach, and of what is to come."""
    cell, data, given = one_day(tmp_path, 1, loud, arm == ARM, arm)
    known = replace(cell, size_prior=WIDTHS)
    found = calib.identify(known, data)
    mean, std = by_hand(data, given, days.SIGMA * found.noise.factor, arm == ARM)
    for values, own in (told(found), told(calib.identify(known, data, approach="pose"))):
        np.testing.assert_allclose((values - mean) / std, 0.0, atol=0.02)
        np.testing.assert_allclose(own, std, rtol=0.02)
    np.testing.assert_allclose(foreseen(known, data, found), told(found)[1], rtol=0.01)
    assert (std < 0.999 * told(calib.identify(cell, data))[1]).all()


def test_it_is_foreseen_as_it_will_count_where_readings_show_the_scatter(tmp_path: Path) -> None:
    cell, data, _ = one_day(tmp_path, 1, scatters=True)
    known = replace(cell, size_prior=WIDTHS)
    found = calib.identify(known, data)
    np.testing.assert_allclose(foreseen(known, data, found), told(found)[1], rtol=0.01)


def test_a_diagnosis_asks_beside_it(tmp_path: Path) -> None:
    """However loud the readings are: fits to first order have it, and the fit in full."""
    cell, data, given = one_day(tmp_path, 1, 8.0)
    found = calib.diagnose(replace(cell, size_prior=WIDTHS), data)
    assert found.verdict == "no_gap"
    mean, std = by_hand(data, given, days.SIGMA * found.noise.factor)
    values, own = told(found)
    np.testing.assert_allclose((values - mean) / std, 0.0, atol=0.05)
    np.testing.assert_allclose(own, std, rtol=0.03)
    assert found.after.model.prior_rows == len(KEYS)
    # What sizes say is no reading.
    fitted = found.after.span.shape[1]
    assert fitted - found.after.spent == round(float(((std / STD) ** 2).sum()))
