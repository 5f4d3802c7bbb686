"""Corrected commands against the arm's own model, brute force, and arms drawn from the covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2, f

import calib
from calib import CalibError, Cell, Poses
from calib.arm.kinematics import forward
from calib.arm.se3 import rotate, so3_log
from calib.arrays import Array
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import errors_at, ignorance
from calib.poses import poses_at
from calib.prediction import commands
from calib.prediction.commands import tip_of
from calib.prediction.compensate import Compensation
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate, estimate_of
from calib.simulation import drawn_readings
from tests.day import valued
from tests.helpers import cell_of, random_robot, simulated, with_effects

MARKERS = np.array([[0.2, 0.0, 0.05], [0.18, 0.1, -0.04], [0.22, -0.06, -0.08]])
GEOMETRY = ("base", "tool", "geometry")
SOFT = ("joint_compliance", "base_compliance", "bearing_compliance")


def exactly(model: Model, values: Array, start: float = 0.0) -> Estimate:
    """Values known without error."""
    none = np.zeros((len(values), len(values)))
    return Estimate(model, values, none, start, ModelDiscrepancy(0.0, "fitted poses"), ())


def drawn(cell: Cell, rng: np.random.Generator, size: float = 1.0) -> Estimate:
    """A robot with errors of plausible size in every parameter."""
    model = build(cell).model
    return exactly(model, size * model.sizes * rng.uniform(0.2, 1.0, len(model.parameters)))


def arm_of(seed: int, effects: tuple[str, ...], dof: int = 6) -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return cell_of(random_robot(rng, dof), MARKERS, effects), rng


def wanted(known: Estimate, found: Compensation) -> Array:
    """Readings of the tool points in their wanted places, (m, M, 3): nominal chain, then base."""
    tip = forward(known.model.robot, found.targets.q)
    markers = known.model.marker_positions(known.values)
    points = rotate(tip.R[:, -1, None], markers) + tip.o[:, -1, None]
    return known.model.readings(known.values, found.targets, points)


def missed(readings: Array, places: Array) -> Array:
    """Mean square distance of the points at each target, m^2."""
    return ((readings - places) ** 2).sum(axis=-1).mean(axis=-1)


def band(known: Estimate, poses: Poses) -> tuple[float, float]:
    """What one draw of the parameters makes of RMS / expected RMS, 999 times in 1000.

    The mean square over the targets is ``sum_i lambda_i z_i^2`` with the eigenvalues of the covariance
    under the targets' mean of J^T J: a chi-square of (sum lambda)^2 / sum lambda^2 degrees of freedom
    to its first two moments (Welch and Satterthwaite).
    """
    _, J = known.model.jacobian(known.values, poses)
    rows = J.reshape(-1, J.shape[-1])
    spread = np.linalg.eigvals(known.covariance @ rows.T @ rows).real
    dof = spread.sum() ** 2 / (spread**2).sum()
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], dof) / dof)
    return float(low), float(high)


def kr270_targets(cell: Cell, count: int, seed: int) -> Array:
    """Random commands in the inner part of the limits, the wrist well bent."""
    low, high = cell.robot.limits.T
    q = np.random.default_rng(seed).uniform(0.6 * low, 0.6 * high, (count, 6))
    q[:, 4] = np.where(np.abs(q[:, 4]) < 0.3, 0.5, q[:, 4])
    return q


# -- The arm comes where it is wanted


@pytest.mark.parametrize(("dof", "prismatic"), [(6, ()), (7, (0,)), (8, ())])
def test_the_arm_as_identified_reaches_the_nominal_pose(dof: int, prismatic: tuple[int]) -> None:
    rng = np.random.default_rng(dof)
    robot = random_robot(rng, dof, prismatic)
    cell = cell_of(robot, MARKERS, [*GEOMETRY, "transmission_harmonic", *SOFT])
    known, wrench = drawn(cell, rng), rng.normal(size=(40, 6)) * 100.0
    targets = poses_at(rng.uniform(*(0.7 * robot.sample_limits().T), (40, dof)), wrench=wrench)
    found = calib.compensate(cell, known, targets)
    reached = tip_of(known.model, known.values, replace(found.targets, q=found.q))
    nominal, met = forward(robot, targets.q), np.array(found.limited_by) == ""
    assert met.mean() > 0.8
    assert found.rms(found.before) > 1e-3
    np.testing.assert_allclose(reached.o[met, -1], nominal.o[met, -1], atol=1e-8)
    np.testing.assert_allclose(reached.R[met, -1], nominal.R[met, -1], atol=1e-7)
    assert found.left[met].max() < 1e-7
    assert (found.left <= found.before + 1e-9).all()


def test_loaded_milling_arm_meets_its_targets_as_expected(kr270: Cell, table_two: Poses) -> None:
    """250 kg on the tool: identified from simulated readings, judged by the full nonlinear truth."""
    data, model, truth = simulated(kr270, table_two, 3)
    known = estimate_of(calib.identify(kr270, data))
    found = calib.compensate(kr270, known, kr270_targets(kr270, 60, 1))
    places, corrected = wanted(known, found), replace(found.targets, q=found.q)
    before, after = (missed(model.predict(truth, p), places) for p in (found.targets, corrected))
    met = found.left < 1e-7
    assert met.mean() > 0.9
    assert np.sqrt(before.mean()) > 3e-3
    np.testing.assert_allclose(np.sqrt(before), found.before, rtol=0.05)
    low, high = band(known, corrected.take(met))
    ratio = np.sqrt(after[met].mean() / (found.expected[met] ** 2).mean())
    assert low < ratio < high
    assert np.sqrt(after[met].mean()) < 3e-5
    unloaded = model.predict(truth, replace(corrected, load_mass=np.zeros(60)))
    assert np.sqrt(missed(unloaded, places).mean()) > 2e-3, "the load must matter here"


def test_what_the_model_lacks_is_part_of_what_is_expected() -> None:
    """Gear errors in the truth and none in the model: what is left at new poses is what is stated."""
    cell, rng = arm_of(4, GEOMETRY)
    true = build(with_effects(cell, *GEOMETRY, "transmission_harmonic:j3")).model
    values = true.sizes * rng.uniform(-0.3, 0.3, len(true.parameters))
    q = rng.uniform(*cell.robot.limits.T, (120, 6))
    data = drawn_readings(true, values, poses_at(q), cell.noise, rng)
    targets = rng.uniform(*cell.robot.limits.T, (80, 6))
    for heldout in (None, data.take(slice(80, None))):
        known = estimate_of(calib.identify(cell, data.take(slice(80)), heldout=heldout))
        found = calib.compensate(cell, known, targets)
        source = "left-out configurations" if heldout is None else "held-out poses"
        assert found.error.estimate.discrepancy.source == source
        reached = true.predict(values, replace(found.targets, q=found.q))
        after, met = missed(reached, wanted(known, found)), found.left < 1e-7
        assert found.rms(np.hypot(found.error.model, found.error.arm)) > 3e-6
        # The points of a pose err together, so a pose counts once: two samples of poses.
        poses = 80 - len(known.values) // 6 if heldout is None else 40
        low, high = f.ppf([0.0005, 0.9995], met.sum(), poses)
        assert low < after[met].mean() / (found.expected[met] ** 2).mean() < high


@pytest.mark.long
def test_held_out_poses_that_stand_out_count_too(kr270: Cell, table_two: Poses) -> None:
    """After identify and after diagnose alike: one held-out pose in six is 2 mm off."""
    data, model, values = simulated(kr270, table_two, 0)
    again = data.poses.take(np.arange(0, len(data), 5))
    held = drawn_readings(model, values, again, kr270.noise, np.random.default_rng(1))
    held.points[0] += [0.0, 0.002, 0.0]
    identified = calib.identify(kr270, data, heldout=held)
    assert identified.heldout is not None
    assert list(np.flatnonzero(identified.heldout.outlier)) == [0]
    for result in (identified, calib.diagnose(kr270, data, heldout=held)):
        rest = estimate_of(result).discrepancy
        assert rest.source == "held-out poses"
        assert rest.rms == pytest.approx(2e-3 / np.sqrt(len(held)), rel=0.05)


# -- Few joints, limits, and singular poses


def cost(known: Estimate, q: Array, length: float) -> Callable[[Array], Array]:
    """What joints miss the nominal pose of a command by, turns over a length [m]."""
    nominal = forward(known.model.robot, q[None])

    def residual(joints: Array) -> Array:
        tip = tip_of(known.model, known.values, poses_at(joints[None]))
        turn = so3_log(nominal.R[0, -1] @ tip.R[0, -1].T)
        return np.concatenate([tip.o[0, -1] - nominal.o[0, -1], length * turn])

    return residual


@pytest.mark.parametrize("dof", [2, 3, 4, 5])
def test_few_joints_put_the_tip_in_place_first(dof: int) -> None:
    """Against a general least-squares solver that hardly weighs orientation."""
    cell, rng = arm_of(dof, ("geometry",), dof)
    known, q = drawn(cell, rng, 0.5), rng.uniform(-1.5, 1.5, (12, dof))
    found = calib.compensate(cell, known, q)
    assert found.at == "tip"
    for i, own in enumerate(q):
        off = cost(known, own, 1e-4 * cell.robot.reach)
        best = least_squares(off, own, xtol=1e-15, ftol=1e-15)
        assert found.left[i] <= np.linalg.norm(best.fun[:3]) + 2e-6
        assert "fewer than six joints" in found.limited_by[i]
    if dof >= 3:
        assert np.median(found.left) < 1e-6
        assert np.median(found.turn_left) > 1e-5
    assert (found.left < found.before).all()


def test_a_joint_stops_at_its_limit(kr270: Cell) -> None:
    """Where the correction would pass a limit, the rest is the bounded least-squares solution."""
    cell = replace(kr270, load=None, effects=("geometry",))
    known = drawn(cell, np.random.default_rng(1), 0.5)
    q = np.array([0.3, -0.9, 1.1, 0.4, 0.8, 0.5])
    free = calib.compensate(cell, known, q[None])
    assert free.limited_by == ("",)
    limits = cell.robot.limits.copy()
    limits[2, int(free.correction[0, 2] > 0.0)] = q[2]
    cell = replace(cell, robot=replace(cell.robot, limits=limits))
    found = calib.compensate(cell, known, q[None])
    assert found.limited_by == ("limit of A3",)
    assert found.q[0, 2] == q[2]
    rest, whole = [0, 1, 3, 4, 5], cost(known, q, 0.1 * cell.robot.reach)
    best = least_squares(lambda x: whole(np.insert(x, 2, q[2])), q[rest], xtol=1e-15)
    np.testing.assert_allclose(found.q[0, rest], best.x, atol=1e-5)
    assert 0.0 < found.left[0] < found.before[0]
    assert found.expected[0] == found.left[0]


def test_a_stop_at_a_limit_leaves_no_more_than_a_shorter_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A joint that a long step takes to its limit stays there, far from where a short one ends."""
    cell, rng = arm_of(25, (*GEOMETRY, "transmission_harmonic", *SOFT))
    known, wrench = drawn(cell, rng), rng.normal(size=(80, 6)) * 100.0
    q = rng.uniform(*cell.robot.sample_limits().T, (80, 6))
    found = calib.compensate(cell, known, poses_at(q, wrench=wrench))
    monkeypatch.setattr(commands, "_SWINGS", commands._SWINGS[:1])
    far = calib.compensate(cell, known, poses_at(q, wrench=wrench))
    assert any("limit" in why for why in far.limited_by)
    assert found.rms(found.left) < 0.2 * far.rms(far.left)


def test_straight_wrist_is_not_swung_round(kr270: Cell) -> None:
    cell = replace(kr270, load=None, effects=("geometry",))
    known = drawn(cell, np.random.default_rng(2))
    found = calib.compensate(cell, known, np.array([[0.2, -0.9, 1.2, 0.3, 0.0, 0.4]]))
    assert found.limited_by == ("singular",)
    assert np.abs(found.correction).max() < 0.1
    assert found.left[0] < 0.2 * found.before[0]


# -- What counts, and what does not


def test_where_and_how_the_instrument_reads_does_not_move_the_arm() -> None:
    cell, rng = arm_of(7, ("base", "tool", "joint_offset:j3", "tracker_scale"))
    model = build(cell).model
    values, q = model.sizes * rng.normal(size=len(model.sizes)), rng.uniform(-1.5, 1.5, (10, 6))
    kinds = np.array([p.effect for p in model.parameters])
    other = np.where(np.isin(kinds, ["base", "tracker_scale"]), -3.0, 1.0) * values
    cov = np.diag(model.sizes**2) * 1e-6
    given = Estimate(model, values, cov, 0.0, ModelDiscrepancy(0.0, ""), ())
    blind = replace(given, covariance=cov * (kinds != "tracker_scale"))
    first, second, third = (
        calib.compensate(cell, own, q) for own in (given, replace(given, values=other), blind)
    )
    np.testing.assert_allclose(first.q, second.q, atol=1e-9)
    np.testing.assert_allclose(first.before, second.before, atol=1e-9)
    np.testing.assert_allclose(first.error.parameters, third.error.parameters, rtol=1e-12)


def test_what_was_not_identified_counts_only_where_it_shows() -> None:
    """An offset of a joint that never moved went into the markers: right there, wrong elsewhere."""
    cell, rng = arm_of(5, ("base", "tool", "joint_offset:j4,j5"))
    model = build(cell).model
    still = rng.uniform(-1.5, 1.5, (30, 6))
    still[:, 3:] = 0.3  # joints 4 to 6 never move: their offsets are those of the markers
    values = np.zeros(len(model.parameters))
    lost = np.array([p.effect == "joint_offset" for p in model.parameters])
    _, J = model.jacobian(values, poses_at(still))
    span = np.eye(len(lost))[:, ~lost]
    cov = ignorance(J.reshape(-1, len(lost)), span, model.sizes, lost)
    elsewhere = np.where(np.arange(6) < 3, still, -1.0)
    here, there = (errors_at(model, values, cov, poses_at(q)) for q in (still, elsewhere))
    assert here.max() < 1e-9
    assert there.min() > 1e-5


def test_backlash_follows_the_side_from_which_joints_come() -> None:
    cell, rng = arm_of(3, ("base", "tool", "backlash:j2"))
    q = rng.uniform(-1.5, 1.5, (6, 6))
    sided = poses_at(q, approach=np.ones_like(q))
    model = build(cell, sided).model
    known = exactly(model, valued(model, backlash=3e-4))
    given = calib.compensate(cell, known, sided)
    np.testing.assert_allclose(given.correction[:, 1], -3e-4, atol=1e-9)
    assert given.notes == ()
    ordered = calib.compensate(cell, known, q)
    signs = np.sign(np.diff(q[:, 1], prepend=q[:1, 1]))
    np.testing.assert_allclose(ordered.correction[:, 1], -3e-4 * signs, atol=1e-9)
    assert "derived from the order of the table" in ordered.notes[0]
    assert "p0000" in ordered.notes[1]
    assert len(ordered.notes) == 2
    # A move smaller than the correction is turned round by it.
    steps = q[0] + np.outer([0.0, 0.1, 0.1001, 0.1], np.eye(6)[1])
    turned = calib.compensate(cell, known, steps)
    assert any("turn a small move round before p0003" in note for note in turned.notes)


def test_drift_and_heat_rest_where_the_targets_do_not_say() -> None:
    cell, rng = arm_of(6, ("tool", "base_drift", "thermal_expansion:arm"))
    q = rng.uniform(-1.5, 1.5, (5, 6))
    session = poses_at(q, time=np.full(5, 7200.0), temperature=np.full(5, 25.0))
    model = build(cell, session).model
    known = exactly(model, valued(model, base_drift=1e-7 * np.eye(6)[0]), 3600.0)
    cold, warm = (calib.compensate(cell, known, own) for own in (q, session))
    assert (len(cold.notes), cold.before.max()) == (2, 0.0)
    np.testing.assert_allclose(warm.before, 1e-7 * 3600.0, rtol=1e-9)
    assert warm.notes == ()


def test_unusable_calls_are_refused(kr270: Cell) -> None:
    model = build(with_effects(kr270, "base", "tool")).model
    known, q = exactly(model, valued(model)), kr270_targets(kr270, 3, 0)
    outside, broken = q.copy(), q.copy()
    outside[1, 4], broken[0, 0] = 2.5, np.nan
    for cell, targets, weights, text in (
        (arm_of(0, ("base",))[0], q, None, "robot with joints A1"),
        (kr270, outside, None, "target p0001: A5 at 143.24 deg is outside"),
        (kr270, broken, None, "no numbers"),
        (kr270, q[:0], None, "no targets"),
        (kr270, q, np.zeros(3), "weights"),
        (kr270, q, np.ones(2), "weights"),
    ):
        with pytest.raises(CalibError, match=text):
            calib.compensate(cell, known, targets, weights=weights)
    with pytest.raises(CalibError, match="did not converge"):
        calib.compensate(kr270, replace(known, converged=False), q)


def test_weights_count_in_the_mean_and_nowhere_else(kr270: Cell) -> None:
    known = drawn(with_effects(kr270, *GEOMETRY), np.random.default_rng(0))
    q = kr270_targets(kr270, 4, 5)
    plain = calib.compensate(kr270, known, q)
    first = calib.compensate(kr270, known, q, weights=np.array([1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(plain.q, first.q)
    assert first.rms(first.before) == pytest.approx(first.before[0])
