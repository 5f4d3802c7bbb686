"""What is expected at targets: the budget, what a model lacks, trends, and what was never measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements, Poses
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.files.estimate import load_estimate
from calib.inference.coverage import coverage_factor, effective_freedom
from calib.model import Model
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.prediction.budget import budget_of
from calib.prediction.discrepancy import FittedModel, model_discrepancy
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of
from calib.simulation import drawn_readings
from doe.forecast.enough import enough
from studies.render import markdown
from studies.results.base import envelope
from studies.results.enough import EnoughResult
from tests import plain_day as days
from tests.day import Floor, day
from tests.helpers import cell_of, random_robot
from tests.properties.every_instrument import scene
from tests.studies.command_line import run

GEOMETRY = ("base", "tool", "geometry")
MARKERS = np.array([[0.2, 0.0, 0.05], [0.18, 0.1, -0.04], [0.22, -0.06, -0.08]])


def rms(vectors: Array) -> float:
    """3-D, of all points."""
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))


# -- The budget against days by other code, and a sheet worked by hand


def test_total_and_intervals_hold_over_a_thousand_days(tmp_path: Path) -> None:
    rng, count = np.random.default_rng(3), 1000
    targets, q = days.joints(12, np.random.default_rng(77)), days.joints(18, rng)
    true = days.points(days.TRUE, q)
    (tmp_path / "data.csv").write_text(days.table(q, days.read(true, rng)))
    cell = calib.load_cell(days.write_cell(tmp_path))
    found = calib.identify(cell, calib.load_measurements(cell, tmp_path / "data.csv"))
    budget = budget_of(found, estimate_of(found), poses_at(targets), np.ones(12))
    expected = budget.expected
    gain = days.slopes(targets) @ np.linalg.pinv(days.slopes(q))
    off = np.array([days.read(true, rng) - true for _ in range(count)]).reshape(count, -1)
    missed = (off @ gain.T).reshape(count, 12, 3, 3)
    errors = np.sqrt((missed**2).sum(axis=-1).mean(axis=-1))
    assert budget.rms(expected.errors) == pytest.approx(np.sqrt((errors**2).mean()), rel=0.05)
    np.testing.assert_allclose(expected.errors, np.sqrt((errors**2).mean(axis=0)), rtol=0.08)
    held = (errors <= expected.expanded).mean(axis=0)
    assert held.mean() == pytest.approx(0.95, abs=0.015)
    assert np.abs(held - 0.95).max() < 0.03


def test_the_gauge_block_of_the_guide() -> None:
    """JCGM 100, H.1: five influences, 16.7 degrees of freedom, t of 99 % 2.92 at 16, U = 93 nm."""
    parts = [(25.0**2, 18.0), (9.7**2, 25.6), (2.9**2, 50.0), (16.6**2, 2.0)]
    nu = float(effective_freedom(parts))
    assert nu == pytest.approx(16.7, abs=0.2)
    factor = float(coverage_factor(np.floor(nu), level=0.99))
    assert factor == pytest.approx(2.92, abs=0.005)
    assert factor * np.sqrt(sum(v for v, _ in parts)) == pytest.approx(93.0, abs=1.0)
    # 95 % of the lengths of a normal error in space lie within 2.795 standard deviations.
    assert float(coverage_factor(np.inf, 3.0)) * np.sqrt(3.0) == pytest.approx(2.7955, abs=1e-3)
    assert float(effective_freedom([(1.0, np.inf), (1e-20, 3.0)])) == np.inf


# -- What a fit leaves: left-out configurations, and noise that is the instrument's


def session(poses: int, louder: float, markers: int, seed: int) -> tuple[Cell, Measurements]:
    """Cell, and readings with an instrument so many times noisier than it says."""
    rng = np.random.default_rng(seed)
    cell = cell_of(random_robot(rng, 6), MARKERS[:markers], GEOMETRY)
    model = build(cell).model
    values = model.sizes * rng.uniform(-0.3, 0.3, len(model.parameters))
    noise = Noise(*(louder * s for s in (cell.noise.along, cell.noise.across, 0.0, 0.0)))
    measured = poses_at(rng.uniform(*cell.robot.limits.T, size=(poses, 6)))
    return cell, drawn_readings(model, values, measured, noise, rng)


def fitted(cell: Cell, data: Measurements) -> tuple[calib.Identification, FittedModel, Array]:
    """A result, its model at work, and the span of what was estimated."""
    found = calib.identify(cell, data)
    assert not found.fit.outlier.any()
    span = np.eye(len(found.values))[:, found.std > 0.0]
    known = (found.model, found.values, found.covariance, span)
    return found, FittedModel(*known, data, found.weights, 1e-5, None), span


def test_left_out_configurations_are_those_of_refits() -> None:
    """Poses are taken out and the rest identified: what they then miss by was foreseen."""
    cell, data = session(30, 1.0, 3, 1)
    _, fit, _ = fitted(cell, data)
    errors, rows = fit.left_out(data.poses.configuration)
    assert rows.determined.all()
    assert rows.growth.min() > 1.0
    for i in (0, 7, 19):
        rest = calib.identify(cell, data.take(np.delete(np.arange(30), i)))
        own = data.take([i])
        missed = own.points - rest.predict(own.poses)
        np.testing.assert_allclose(errors[i], missed[0], atol=0.02 * np.abs(missed).max())


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_a_noisy_instrument_is_no_model_error(seed: int) -> None:
    """Three times noisier than stated, three markers: the shape of the marker set tells."""
    cell, data = session(60, 3.0, 3, seed)
    found = calib.identify(cell, data)
    assert found.noise.source == "residual"
    known = estimate_of(found)
    assert (known.discrepancy.rms, known.notes) == (0.0, ())
    assert found.noise.sigma == pytest.approx(3.0 * cell.noise.along, rel=0.1)


def test_one_marker_cannot_tell_and_says_so() -> None:
    cell, data = session(60, 3.0, 1, 0)
    known = estimate_of(calib.identify(cell, data))
    total = known.discrepancy.rms
    if known.variances is not None:
        tip = known.variances.approach + known.variances.configuration
        total = float(np.sqrt(total**2 + 3.0 * tip[-2]))
    assert total > 2.0 * np.sqrt(3.0) * cell.noise.along
    assert "cannot tell the instrument from the arm" in " ".join(known.notes)
    quiet, data = session(60, 1.0, 1, 0)
    assert estimate_of(calib.identify(quiet, data)).notes == ()


def test_instruments_that_read_no_length_do_not_speak_of_any() -> None:
    """A camera beside a wire: what is unseen is that of the wire, however many corners there are."""
    here = scene(8, 25)
    offset = EFFECTS["joint_offset"].at(here.context, "j2")
    read = tuple(i for i in here.context.instruments if i.kind in ("camera", "distance"))
    context = replace(here.context, instruments=read)
    base = [EFFECTS["base"].at(context, w) for w in EFFECTS["base"].places(context)]
    model = replace(here.model(), instruments=read, effects=(*base, offset))
    values = here.at(model)
    data = drawn_readings(model, values, here.poses, None, np.random.default_rng(0))
    wire = next(part for i, part in model.readout.channels.blocks if i.kind == "distance")
    weights = model.readout.whitening(values, data.poses, data.readings, data.sigma)
    none, every = np.zeros((len(values), len(values))), np.eye(len(values))
    fit = FittedModel(model, values, none, every, data, weights, 2e-5, None)
    off = data.readings.copy()
    off[:, wire, 0] += 1e-3
    heldout = replace(data, readings=off)
    shown = fit.squared(heldout, *fit.predicted(heldout))
    assert shown.beyond(shown.noise) == pytest.approx(1e-3, rel=1e-2)
    assert model_discrepancy(fit, heldout, 1.0).rms == pytest.approx(1e-3, rel=1e-2)


# -- A base that warms in MuJoCo while it is measured: what comes an hour later was said before


@cache
def warming(
    index: int, size: float = 1e-4, timed: bool = True
) -> tuple[Cell, Measurements, Estimate, Poses, float]:
    """Cell, data, estimate, targets an hour later, and by how much it misses them, RMS, m.

    size : m and rad of one standard deviation; timed : whether the cell says when targets come
    """
    rng = np.random.default_rng([index, 5])
    far, tau = rng.normal(size=6) * size, rng.uniform(0.5, 2.0)
    floor = Floor(lambda h: far * (1.0 - np.exp(-h / tau))[:, None], told=timed)
    cell, data, _, truth = day("6R", seed=5, index=index, poses=40, floor=floor)
    found = calib.identify(cell, data)
    targets, _ = calib.load_targets(cell, cell.path.with_name("targets.csv"))
    off = rms(found.predict(targets) - truth.reached)
    return cell, data, estimate_of(found, 3600.0), targets, off


def test_the_trend_is_carried_on() -> None:
    ratios = []
    for index in range(5):
        _, _, known, targets, came = warming(index)
        assert known.trend is not None
        said = ExpectedError(known, targets)
        assert (said.model >= said.trend).all()
        ratios.append(came / float(np.sqrt((said.trend**2).mean())))
    assert 0.6 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.2
    assert max(ratios) < 2.0


def test_a_trend_is_handed_on_by_file() -> None:
    cell, _, known, targets, _ = warming(0)
    out, table = (cell.path.with_name(name) for name in ("result.json", "measurements.csv"))
    done = run("identify", cell.path, table, "--json", out)
    assert done.exit_code == 0, done.output
    read, here = (ExpectedError(own, targets).trend for own in (load_estimate(cell, out), known))
    np.testing.assert_allclose(read, here, rtol=1e-6)
    assert "trend of the day" in out.read_text()
    said = calib.compensate(cell, out, targets)
    np.testing.assert_allclose(said.error.trend, here, rtol=0.02)
    assert any("1 h after the last one" in note for note in said.notes)


@pytest.mark.parametrize("days", [range(3), pytest.param(range(3, 10), marks=pytest.mark.long)])
def test_a_base_that_stands_has_no_trend(days: range) -> None:
    assert all(warming(index, size=0.0)[2].trend is None for index in days)


@pytest.mark.parametrize("timed", [False, pytest.param(True, marks=pytest.mark.long)])
def test_nobody_is_told_to_stop_while_it_goes_on(timed: bool) -> None:
    """Unless the cell says when the targets come: then the bound is for that time."""
    cell, data, _, _, came = warming(2, timed=timed)
    answer = enough(cell, data, goal=1e-2)
    made_from = envelope(cell.name, [cell.path], 0)
    said = markdown(EnoughResult.of(answer, cell, made_from)).replace("\\", "")
    assert answer.lacking.trend > 0.0
    assert ("You may stop" in said) == timed
    assert ("targets_after_h" in said) == (not timed)
    assert "run `posecal diagnose`" in said.lower()
    if timed:
        assert came <= answer.steps[0].task_most
        assert enough(cell, data, goal=0.9 * came).needed is None


# -- What targets ask and no reading had


def asked(cell: Cell, rng: np.random.Generator, count: int, kind: str, target: bool) -> Poses:
    limits = np.clip(cell.robot.limits, -2.0, 2.0)
    q = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * rng.random((count, cell.robot.dof))
    if kind == "backlash":
        return poses_at(q, approach=np.full(q.shape, -1.0 if target else 1.0))
    given = {}
    if kind == "joint_compliance" and target:
        given["wrench"] = np.tile([0.0, 0.0, -500.0, 0.0, 0.0, 0.0], (count, 1))
    if kind == "base_drift":
        given["time"] = np.full(count, 6 * 3600.0) if target else np.linspace(0.0, 3600.0, count)
    return with_moves(poses_at(q, **given))


def unmeasured(kr270: Cell, kind: str, seed: int) -> tuple[Cell, Measurements, Poses, Model, Array]:
    """An arm whose weight bends nothing, with an effect that its model lacks, and its targets."""
    rng, cell = np.random.default_rng(seed), replace(kr270, load=None, gravity=np.zeros(3))
    poses, targets = (asked(cell, rng, n, kind, of) for n, of in ((40, False), (15, True)))
    loaded = replace(poses, wrench=np.ones_like(poses.wrench))
    model = build(replace(cell, effects=(*GEOMETRY, kind)), loaded).model
    truth = model.initial.copy()
    for i, p in enumerate(model.parameters):
        if p.effect == kind:
            # A drive turns by about a milliradian under the weight of its arm (850 kg, at 0.7 m); gears
            # have play of 20 to 200 urad.
            soft = abs(rng.normal()) * 1e-3 / (850.0 * 9.81 * 0.7)
            play = rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(*np.log([2e-5, 2e-4])))
            own = {"joint_compliance": soft, "backlash": play}
            truth[i] = own.get(kind, rng.normal() * p.size)
        elif p.effect == "geometry":
            truth[i] = 0.5 * rng.normal() * p.size
    data = drawn_readings(model, truth, poses, None, rng, arm=cell.repeatability)
    return replace(cell, effects=GEOMETRY), data, targets, model, truth


@pytest.mark.parametrize(
    "kind",
    [pytest.param("joint_compliance", marks=pytest.mark.long),
     pytest.param("base_drift", marks=pytest.mark.long), "backlash"],
)  # fmt: skip
def test_what_was_never_measured_is_promised_at_its_size(kr270: Cell, kind: str) -> None:
    ratios = []
    for seed in range(8):
        cell, data, targets, model, truth = unmeasured(kr270, kind, seed)
        result = calib.identify(cell, data)
        found = calib.compensate(cell, result, targets)
        there = replace(found.targets, q=found.q)
        off = rms(model.predict(truth, there) - result.model.predict(result.values, there))
        ratios.append(float(np.sqrt((found.error.rms**2).mean())) / off)
        assert any(kind in said for said in found.error.never_measured(found.weights))
    assert 0.7 < np.median(ratios) < 1.5


def test_nothing_is_added_at_targets_like_the_readings(kr270: Cell) -> None:
    cell, data, *_ = unmeasured(kr270, "joint_compliance", 0)
    targets = asked(cell, np.random.default_rng(1), 30, "none", True)
    found = calib.compensate(cell, calib.identify(cell, data), targets)
    assert np.sqrt((found.error.unmeasured**2).mean()) < 0.2 * np.sqrt((found.error.rms**2).mean())
