"""What a selection is made of: worth beside others, passes, left-out errors, curves, runs, names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis.candidates import Candidate, candidates
from calib.diagnosis.causes import NameEvidence, Standing, VerdictName, verdict_of
from calib.diagnosis.columns import candidate_set
from calib.diagnosis.compressed import Block, CompressedColumns
from calib.diagnosis.conditional import Conditional, Curvature
from calib.diagnosis.equivalence import classes
from calib.diagnosis.functions import neighbours
from calib.diagnosis.gate import CrossValidation
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.rest import Kind, Rest, rest_of
from calib.diagnosis.search import fitted
from calib.diagnosis.selection import lower_states, selection, start
from calib.diagnosis.serial import chance_of_run, scattered, smooth_run
from calib.diagnosis.stability import _beside, _halves, stability
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.state import SelectedEffect, SelectionState
from calib.inference import Design, GaussianBlock, RandomEffect
from calib.inference.restricted import RestrictedLikelihood
from calib.instruments import KnownDistance, Socket
from calib.model.build import build
from calib.observations.scatter import Variances
from tests.day import SMALL, day, diagnosed, name_chance, name_weights
from tests.helpers import cell_of, random_robot, stage_of
from tests.touched_arm import MARKERS, SITES, contacts_of_a_larger_arm, length

# -- Candidates beside others, against the likelihood of the whole set, entry by entry

POSES, ROWS = 40, 9
THETA = np.array([0.7, 0.3, 0.2, 0.5, 0.1, 0.4, 0.2])


@pytest.fixture(scope="module")
def columns() -> CompressedColumns:
    """Twenty configurations read twice, three joints that scatter, seven columns of candidates."""
    rng = np.random.default_rng(0)

    def rows(k: int) -> Any:
        return rng.normal(size=(POSES, ROWS, k))

    groups = {"configuration": np.repeat(np.arange(POSES // 2), 2), "approach": np.arange(POSES)}
    levers = [rows(1) for _ in range(3)]
    effects = tuple(
        RandomEffect(f"{name}:{k}", own, "joint", group)
        for name, group in groups.items()
        for k, own in enumerate(levers)
    )
    known = GaussianBlock("known", rows(2), np.eye(2), np.zeros(2), 1.0)
    present = np.zeros((POSES, ROWS), dtype=int)
    design = Design(rows(1)[..., 0], rows(5), np.eye(5), (known,), effects, present)
    return CompressedColumns.of(design).with_columns(rows(7))


@pytest.fixture
def blocks(columns: CompressedColumns) -> list[Block]:
    """Three blocks of the candidates' columns, with their sizes."""
    first = columns.response + 1
    parts = ((0, 2, 2.0), (2, 3, 0.5), (3, 6, 1.3))
    return [(np.arange(first + low, first + high), size) for low, high, size in parts]


def whole(columns: CompressedColumns, *own: Block) -> tuple[float, Array]:
    """-2 log likelihood, and its gradient by log variances."""
    found = RestrictedLikelihood(columns.model(own), THETA)
    return found.value, found.derivatives[0]


def test_what_a_candidate_is_worth_is_what_the_likelihood_says(
    columns: CompressedColumns, blocks: list[Block]
) -> None:
    """Gain and change of the gradient: of a newcomer, a member, its rival, and a second newcomer."""
    a, b, c = blocks
    at = columns.at(THETA)
    for beside, own, rest in (
        (Conditional.of(at, [a, b]), c, (a, b)),
        (Conditional.of(at, [a, b]).without(a[0]), a, (b,)),
        (Conditional.of(at, [a, b]).without(a[0]), c, (b,)),
    ):
        asked, size = own[0][None], np.array([own[1]])
        before, after = whole(columns, *rest), whole(columns, *rest, own)
        gain = float(beside.gains(asked, size[None])[0][0])
        assert gain == pytest.approx(before[0] - after[0], abs=1e-9)
        change = beside.changes(asked, size)[0]
        np.testing.assert_allclose(change, after[1] - before[1], atol=1e-9)
    second = Conditional.of(at, [b]).adding(*c)
    gain = float(second.gains(a[0][None], np.array([[a[1]]]))[0][0])
    assert gain == pytest.approx(whole(columns, b, c)[0] - whole(columns, b, c, a)[0], abs=1e-9)


def test_the_best_of_several_amplitudes_counts(
    columns: CompressedColumns, blocks: list[Block]
) -> None:
    own, sizes = blocks[2][0], np.array([0.01, 0.1, 1.0, 10.0])
    gain, size = Conditional.of(columns.at(THETA), []).gains(own[None], sizes[None])
    each = [whole(columns)[0] - whole(columns, (own, float(a)))[0] for a in sizes]
    assert gain[0] == pytest.approx(max(each), abs=1e-9)
    assert size[0] == sizes[int(np.argmax(each))]


def test_a_newton_step_promises_less_than_a_search_finds() -> None:
    """One variance of n rows whose mean square falls to a share q: n (q - 1 - log q) in truth."""
    n, free = 50.0, np.array([True])
    for q in (0.9, 0.5, 0.1):
        curvature = Curvature(np.zeros(1), np.array([[n]]), free)
        promised = float(curvature.promised(np.array([[n * (1.0 - q)]]))[0])
        assert 0.0 < promised <= n * (q - 1.0 - np.log(q))
    held = Curvature(np.zeros(1), np.array([[n]]), ~free)
    assert held.promised(np.array([[n]]))[0] == 0.0


# -- A selection lowers one objective, and where it stops no member is better left out


@pytest.fixture(scope="module")
def passes() -> list[SelectionState]:
    """The states that a selection goes through, of a day on which the elbow errs once a turn."""
    found = diagnosed("", 0.0, 5, "6R", **SMALL)
    asked = found.outcome.state.problem.candidates
    problem = RegressionProblem.of(found.stage, asked, found.outcome.before.span)
    states = [start(problem, ())]
    while len(states) < 20 and (better := next(lower_states(states[-1].scanned()), None)):
        states.append(better)
    return states


def test_the_objective_falls_to_where_no_member_is_better_left_out(
    passes: list[SelectionState],
) -> None:
    assert len(passes) > 1
    assert (np.diff([state.objective for state in passes]) < 0.0).all()
    last = passes[-1]
    assert "transmission_harmonic:elbow" in {m.key for m in last.members}
    for member in last.members:
        rest = tuple(m for m in last.members if m is not member)
        assert last.with_members(rest).objective > last.objective
    again = selection(passes[0].problem, last.active).active
    assert {c.key for c in again} == {c.key for c in last.active}


def test_a_cause_that_is_there_comes_again_in_every_half() -> None:
    for first, second in zip(_halves(21)[::2], _halves(21)[1::2], strict=True):
        assert (first ^ second).all()
        assert first.sum() == 10
    found = diagnosed("", 0.0, 5, "6R", **SMALL)
    named, _ = classes(found.stage, found.outcome)
    assert stability(found.outcome.judged, named)["transmission_harmonic:elbow"] == 1.0


def test_what_is_beside_held_columns_is_that_of_least_squares(rng: np.random.Generator) -> None:
    A, X, r = rng.normal(size=(80, 4)), rng.normal(size=(80, 3)), rng.normal(size=80)
    rows, precision = np.column_stack([A, X, r]), np.array([0.0, 0.0, 2.0, 5.0])
    S, z = _beside(rows.T @ rows, np.arange(4), precision, np.arange(4, 8))
    held = np.concatenate([A, np.diag(np.sqrt(precision))])
    flat = np.concatenate([np.column_stack([X, r]), np.zeros((4, 4))])
    left = flat - held @ np.linalg.lstsq(held, flat, rcond=None)[0]
    np.testing.assert_allclose(S, left[:, :3].T @ left[:, :3], rtol=1e-6)
    np.testing.assert_allclose(z, left[:, :3].T @ left[:, 3], rtol=1e-6, atol=1e-6)


# -- What is left out is predicted as a refit without it predicts it


def asked(cell: Cell, data: Measurements, *keys: str) -> tuple[Stage, list[Candidate]]:
    """Where a diagnosis begins, and candidates by their names."""
    stage = stage_of(cell, data)
    found = {c.key: c for c in candidates(cell, stage.model, data)[0]}
    return stage, [found[key] for key in keys]


def predicted(stage: Stage, effects: list[Candidate], by_time: bool) -> float:
    """3-D RMS of what is a length at folds predicted by refits without them, m."""
    data = stage.data
    fold = CrossValidation.of(stage, stage.fit(()), by_time).fold
    lengths = stage.model.readout.channels.lengths
    squares = 0.0
    for f in range(int(fold.max()) + 1):
        fit = replace(stage, dropped=fold == f).fit([c.effect for c in effects])
        part: Measurements = data.take(fold == f)
        squares += float((fit.model.off(fit.values, part) ** 2 * lengths).sum())
    return float(np.sqrt(squares / (data.seen & lengths.any(axis=-1)).sum()))


@pytest.mark.long
def test_left_out_errors_are_those_of_refits() -> None:
    """Of stretches of time; of poses by chance below, beside a camera."""
    cell, data, _, _ = day("kr270", "backlash:A3", 2e-4)
    # Of one parameter: no common size.
    stage, (right, wrong) = asked(cell, data, "backlash:A3", "backlash:A5")
    both = predicted(stage, [right, wrong], True)
    crossed = CrossValidation.of(stage, stage.fit([right.effect, wrong.effect]), True)
    for member, rest in ((right, wrong), (wrong, right)):
        found = crossed.errors([member.effect])
        assert found.rms_with == pytest.approx(both, rel=0.02)
        assert found.rms_without == pytest.approx(predicted(stage, [rest], True), rel=0.02)
        assert found.earns == (member is right)


@pytest.mark.long
def test_beside_a_camera_lengths_alone_are_told_in_mm(tmp_path: Path) -> None:
    """A pixel is no metre: the errors are those of the tracker's points."""
    pytest.importorskip("cv2", exc_type=ImportError)
    from tests.camera_days import SETUPS, Truth, kr270_day

    truth = Truth(np.array([0.0, 0.0, 8e-4, 0.0, 0.0, 0.0]))
    cell, data = kr270_day(tmp_path, SETUPS["kr270"], truth, 24, effects='"base", "tool"')
    stage, (right,) = asked(cell, data, "joint_offset:A3")
    crossed = CrossValidation.of(stage, stage.fit([right.effect]), by_time=False)
    found = crossed.errors([right.effect])
    assert found.rms_without == pytest.approx(predicted(stage, [], False), rel=0.1)
    assert found.rms_with == pytest.approx(predicted(stage, [right], False), rel=0.05)
    assert found.rms_with < 1e-4 < found.rms_without < 3e-3


@pytest.mark.parametrize("by_time", [pytest.param(False, marks=pytest.mark.long), True])
def test_known_distances_hold_the_arm_s_size(by_time: bool) -> None:
    """Contacts alone are met by an arm without any length: what is known of lengths counts as well."""
    rng, robot = np.random.default_rng(2), random_robot(np.random.default_rng(12), 6)
    data, centres = contacts_of_a_larger_arm(robot)
    q = data.poses.q + 2e-5 * rng.normal(size=data.poses.q.shape)
    q[:, 2] -= 6e-4 * np.sin(data.poses.q[:, 2])
    data = replace(data, poses=replace(data.poses, q=q))
    pairs = tuple(
        KnownDistance((SITES[a], SITES[b]), float(length(centres[a] - centres[b])), 1e-5)
        for a, b in ((0, 1), (2, 3))
    )
    cell = cell_of(robot, MARKERS[:1] + np.array([0.08, -0.05, 0.06]), ("tool", "geometry"))
    sockets = Socket(name="a", sigma=2e-5, sites=SITES)
    cell = replace(cell, instruments=(sockets,), known_distances=pairs)
    stage, (right,) = asked(cell, data, "transmission_harmonic:j3")
    found = CrossValidation.of(stage, stage.fit([right.effect]), by_time).errors([right.effect])
    assert found.rms_with == pytest.approx(predicted(stage, [right], by_time), rel=0.02)
    assert found.rms_without == pytest.approx(predicted(stage, [], by_time), rel=0.02)
    assert found.rms_with > 1e-5
    assert found.earns


# -- Curves without a name


def test_neighbours_are_the_expectation_of_a_normal_field() -> None:
    """At the centres the coefficients themselves, elsewhere ordinary kriging with the same kernel."""
    rng = np.random.default_rng(3)
    field = neighbours(rng.normal(size=(20, 3)))
    values = rng.normal(size=len(field.centres))
    np.testing.assert_allclose(field.at(field.centres) @ values, values, atol=1e-9)
    new = rng.normal(size=(4, 3))
    apart = np.linalg.norm(new[:, None] - field.centres, axis=-1)
    kriged = np.exp(-apart / 2.0) @ np.linalg.solve(field.spread, values)
    np.testing.assert_allclose(field.at(new) @ values, kriged, atol=1e-9)


def test_derivatives_of_curves() -> None:
    """Against central differences of the prediction."""
    cell, data, _, _ = day()
    base = build(cell, data.poses).model
    suspects, _ = candidates(cell, base, data)
    poses = data.poses.take(slice(0, 60, 15))
    for kind in ("TwistCurve", "MarkerCurve", "RangeCurve"):
        chosen = [c.effect for c in suspects if type(c.effect).__name__ == kind]
        model = base.with_effects((*base.effects, chosen[len(chosen) // 2]))
        values = model.sizes * np.random.default_rng(3).normal(size=len(model.parameters))
        _, J = model.jacobian(values, poses)
        own = np.arange(len(base.parameters), len(values))
        steps = 1e-5 * np.eye(len(values))[own]
        ends = [model.predict(values + s * steps, poses) for s in (0.5, -0.5)]
        numeric = np.moveaxis(ends[0] - ends[1], 0, -1) / 1e-5
        np.testing.assert_allclose(J[..., own], numeric, atol=1e-6)


def test_a_curve_is_shrunk_by_as_much_as_the_data_leave_open() -> None:
    """A fit of pure noise keeps a curve far below what least squares would make of it."""
    cell, data, _, _ = day()
    stage = stage_of(cell, data)
    suspects, _ = candidates(cell, stage.model, data)
    curve = next(c for c in suspects if not c.named and c.depends_on.startswith("q:"))
    before = stage.fit()
    problem = RegressionProblem.of(stage, candidate_set(stage, before, suspects, ()), before.span)
    (member,) = (c for c in problem.fixed if c.candidate.key == curve.key)
    state = start(problem, ()).with_members((SelectedEffect(member, 1.0),))
    fit = fitted(stage, state, before)
    own, J = fit.positions(curve.effect), fit.J.reshape(-1, fit.J.shape[-1])
    free = np.linalg.lstsq(J, fit.r.ravel() + J @ fit.values, rcond=1e-9)[0]
    moved, unheld = (float(np.linalg.norm(J[:, own] @ v[own])) for v in (fit.values, free))
    assert moved < 0.6 * unheld


# -- What scatters runs smoothly with nothing; a joint that walks does, with time

SIZE, JOINT = 1e-4, 1


def test_independent_values_come_by_chance_as_often_as_said(rng: np.random.Generator) -> None:
    found = np.array([chance_of_run(rng.normal(size=30)) for _ in range(2000)])
    assert np.mean(found < 0.05) == pytest.approx(0.05, abs=0.02)
    assert chance_of_run(np.cumsum(rng.normal(size=40))) < 1e-4


def moved(off: Array) -> tuple[Stage, Fit]:
    """A day on which a joint is off by so much in each configuration, under that scatter."""
    cell, data, _, _ = day(seed=3)
    stage = stage_of(cell, data)
    levers = stage.scatter.levers[..., JOINT]
    readings = data.readings + levers * off[data.poses.configuration][:, None, None]
    stage = replace(stage, data=replace(data, readings=readings))
    variances = Variances.none(cell.robot.dof)
    variances.configuration[JOINT] = SIZE**2
    return stage, stage.fit((), variances=variances)


@pytest.mark.parametrize("walks", [False, True])
def test_what_a_joint_was_off_by_is_predicted_and_runs_with_time(
    rng: np.random.Generator, walks: bool
) -> None:
    cell, data, _, _ = day(seed=3)
    where, clock = data.poses.configuration, data.poses.clock
    count = int(where.max()) + 1
    off = rng.normal(size=count)
    if walks:
        off[np.argsort([clock[where == c].min() for c in range(count)])] = np.cumsum(off.copy())
    off = SIZE * (off - off.mean()) / off.std()
    stage, fit = moved(off)
    found = scattered(stage, fit)[0][:, JOINT]
    assert np.corrcoef(found, off[where])[0, 1] > 0.7
    run = smooth_run(stage, fit)
    told = None if run is None else (run.where, run.depends_on)
    assert told == ((cell.robot.joints[JOINT], "time") if walks else None)


# -- Whatever speaks against a name makes it less likely, and nothing makes it certain

PLAIN = NameEvidence("transmission_harmonic:j2", 1.0, 0.5, 0.0, 1.0, company=False)


@pytest.mark.parametrize(
    "against", [{"form_p": 1e-3}, {"curve_ratio": 1.2}, {"again": 0.8}, {"company": True}]
)
def test_what_speaks_against_a_name_lowers_it(against: dict[str, Any]) -> None:
    assert 0.9 < PLAIN.probability < 1.0
    assert replace(PLAIN, **against).probability < PLAIN.probability


def test_an_error_of_form_counts_by_its_part() -> None:
    doubted = replace(PLAIN, form_p=1e-6)
    minor = replace(doubted, form_share=0.02)
    assert doubted.probability < 0.92 < minor.probability < PLAIN.probability


def test_a_cause_that_follows_what_it_likes_is_less_likely() -> None:
    nearly = replace(PLAIN, curve_ratio=0.9)
    assert nearly.probability == PLAIN.probability
    assert replace(nearly, key="stiffness_vs_angle:j2").probability < 0.8
    assert replace(nearly, key="step:j2").probability < 0.9
    assert replace(nearly, key="step:base").probability == PLAIN.probability
    assert replace(PLAIN, key="step:j2").probability == PLAIN.probability


def test_weights_of_names_are_found_again() -> None:
    rng, truth = np.random.default_rng(3), np.array([1.0, -2.0, 0.5])
    A = np.column_stack([np.ones(4000), rng.normal(size=(4000, 2))])
    right = (rng.random(4000) < name_chance(A, truth)).astype(float)
    assert name_weights(A, right, (0.0, 1.0, 1.0)) == pytest.approx(truth, abs=0.2)


# -- The verdict follows from what is established and what remains

VERDICTS: list[tuple[tuple[Standing, ...], bool, Kind, VerdictName]] = [
    ((), False, "none", "no_gap"),
    ((), True, "none", "unknown"),
    ((), False, "structure", "unknown"),
    (("established", "established"), False, "scatter", "explained"),
    (("established",), True, "none", "partly"),
    (("established",), False, "structure", "partly"),
    (("established",), False, "too_large", "partly"),
    (("established", "one_of"), False, "none", "ambiguous"),
    (("one_of",), False, "structure", "ambiguous"),
    (("established", "likely"), False, "none", "ambiguous"),
    (("likely", "likely"), False, "none", "unknown"),
]


def test_what_runs_smoothly_or_gross_poses_are_no_scatter() -> None:
    found = diagnosed("", 0.0, 5, "6R", **SMALL)
    for smooth, left_out, kind in (
        (False, 0, "none"),
        (True, 0, "structure"),
        (False, 5, "structure"),
    ):
        assert rest_of(found, smooth, left_out).kind == kind


@pytest.mark.parametrize(("standings", "more", "kind", "verdict"), VERDICTS)
def test_the_verdict_follows(
    standings: tuple[Standing, ...], more: bool, kind: Kind, verdict: VerdictName
) -> None:
    rest = Rest(1e-5, kind, "model", 3e-5, "assumed")
    assert verdict_of(standings, more, rest) == verdict
