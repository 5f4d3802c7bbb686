"""What a plan is said to see, against diagnoses, least squares and simulated choices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.inference.evidence import score_test, visible_directions
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from doe.forecast.accuracy import most_useful_first
from doe.forecast.foresee import PowerAnalysis, foresee
from doe.forecast.likeness import SURE, likeness, plausible
from doe.information import TargetErrors
from tests.helpers import all_seen, cell_of, random_robot, with_effects

MODEL = ("base", "tool", "geometry", "joint_compliance:A2,A3,A4,A5,A6")


def session(cell: Cell, count: int, seed: int = 0) -> Poses:
    """Configurations, free and loaded, over some hours and kelvins."""
    rng = np.random.default_rng(seed)
    low, high = cell.robot.sample_limits().T
    index = np.arange(2.0 * count)
    return with_moves(
        poses_at(
            np.repeat(rng.uniform(low, high, (count, 6)), 2, axis=0),
            time=index * 60.0,
            temperature=20.0 + 3.0 * np.sin(index / 9.0),
            load_mass=np.tile([0.0, 200.0], count),
            load_com=np.array([0.3, 0.0, 0.15]),
        )
    )


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *MODEL), load=None)


@pytest.fixture(scope="module")
def found(cell: Cell) -> PowerAnalysis:
    return foresee(cell, session(cell, 30))


def keys(found: PowerAnalysis, positions: tuple[int, ...]) -> set[str]:
    return {found.seen[i].key for i in positions}


def columns(found: PowerAnalysis, key: str) -> np.ndarray:
    return found.detection.columns[[c.key for c in found.detection.causes].index(key)]


@pytest.mark.long
def test_a_smallest_size_is_found_nine_times_in_ten(found: PowerAnalysis) -> None:
    rng = np.random.default_rng(1)
    for key in ("backlash:A5", "transmission_harmonic:A2", "base_drift:base", "payload:payload"):
        cause = next(s for s in found.seen if s.key == key)
        own = columns(found, key)
        X, lengths = found.detection.left[:, own], np.linalg.norm(found.detection.X[:, own], axis=0)
        signal = X[:, cause.lead] * cause.smallest[cause.lead]
        draws = signal + rng.normal(size=(400, len(signal)))
        falls = np.array([float(score_test(X.T @ X, X.T @ r, lengths)[0]) for r in draws])
        assert np.mean(falls > cause.limit) == pytest.approx(0.9, abs=0.06), key
        assert cause.found(np.ones(1))[0] == pytest.approx(0.9)


@pytest.mark.long
@pytest.mark.parametrize(("times", "places"), [(0.2, []), (1.6, ["A3"])])
def test_a_diagnosis_finds_what_is_larger_and_no_less(
    cell: Cell, found: PowerAnalysis, times: float, places: list[str]
) -> None:
    cause = next(s for s in found.seen if s.key == "backlash:A3")
    poses = found.data.poses
    model = build(with_effects(cell, *MODEL, cause.key), poses).model
    truth = np.concatenate([found.values, times * cause.smallest])
    data = drawn_readings(model, truth, poses, cell.noise, np.random.default_rng(4))
    assert [place.where for place in calib.diagnose(cell, data).located] == places


def test_the_reading_before_the_first_move_counts_no_more_than_in_a_diagnosis() -> None:
    """The stated size has the stated noncentrality by plain least squares on what is left."""
    rng = np.random.default_rng(0)
    robot = random_robot(rng, 4)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (2, 3)), ("base", "tool"))
    plan = poses_at(rng.uniform(*robot.sample_limits().T, (9, 4)))
    derived = foresee(cell, plan)
    assert np.flatnonzero(derived.waiting).tolist() == [0]
    poses = with_moves(plan)
    given = foresee(cell, replace(poses, approach_derived=False))
    assert not given.waiting.any()
    for seen, first in ((derived, 1), (given, 0)):
        cause = next(s for s in seen.seen if s.key == "backlash:j2")
        columns = [calib.observation(with_effects(cell, *more), poses)[first:]
                   for more in (("base", "tool"), ("base", "tool", cause.key))]  # fmt: skip
        N, X = (rows.reshape(-1, rows.shape[-1]) / cell.noise.across for rows in columns)
        signal = X[:, -1] * cause.smallest[0]
        left = signal - N @ np.linalg.lstsq(N, signal, rcond=None)[0]
        assert left @ left == pytest.approx(cause.needed, rel=1e-6)
    assert derived.seen[0].smallest[0] > 1.02 * given.seen[0].smallest[0]


def test_facts_that_hold_for_any_robot(found: PowerAnalysis) -> None:
    hidden = {s.key: s.reason for s in found.hidden}
    assert "geometry" in hidden["tracker_scale:instrument"]
    assert hidden["joint_compliance:A1"] == "no load acts on it at these poses"
    confounded = [keys(found, group) for group in found.confounded]
    drifts = {"base_drift:base", "tracker_drift:instrument"}
    assert drifts in confounded


@pytest.mark.long
def test_tilt_of_base_and_first_bearing(cell: Cell) -> None:
    """Alike where the first joint stands at the base's origin, to be told where it stands above."""
    robot = cell.robot
    origins = robot.origins.copy()
    origins[0, :3, 3] = 0.0
    low = replace(cell, robot=replace(robot, origins=origins))
    pair = {"base_compliance:base", "bearing_compliance:A1"}
    plan = session(low, 20)
    assert pair in [keys(f, g) for f in [foresee(low, plan)] for g in f.confounded]
    raised = foresee(cell, plan)
    assert pair not in [keys(raised, group) for group in raised.confounded]


@pytest.mark.long
def test_a_hidden_scale_is_seen_where_lengths_are_known(cell: Cell) -> None:
    known = with_effects(cell, "base")
    scale = next(s for s in foresee(known, session(cell, 12)).seen if s.key.startswith("tracker_s"))
    # Of what moves with the distance only the shift of the mean is a movement of the base.
    # The two readings before the first move do not count.
    points = build(known).model.predict(np.zeros(6), session(cell, 12))[2:].reshape(-1, 3)
    spread = np.sqrt(((points - points.mean(axis=0)) ** 2).sum())
    expected = np.sqrt(scale.needed) * cell.noise.across / spread
    assert scale.smallest[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.long
def test_twice_the_readings_halve_the_needed_square(cell: Cell) -> None:
    plan = session(cell, 20)
    once = foresee(cell, plan)
    twice = foresee(cell, replace(plan.take(np.tile(np.arange(40), 2)), names=("",) * 80))
    for one in once.seen:
        two = next(s for s in twice.seen if s.key == one.key)
        gain = np.sqrt(2.0 * one.needed / two.needed)
        np.testing.assert_allclose(two.smallest * gain, one.smallest, rtol=1e-5)


@pytest.mark.long
def test_a_load_means_two_readings_and_points_do_not_count(kr270: Cell, table_two: Poses) -> None:
    plan = foresee(kr270, table_two)
    assert len(plan.data) == 2 * len(table_two)
    unloaded = replace(kr270, load=None)
    poses = calib.readings(kr270, table_two)
    rng = np.random.default_rng(0)
    table = foresee(unloaded, all_seen(poses, rng.normal(size=(len(poses), 3, 3))))
    assert [s.key for s in table.seen] == [s.key for s in plan.seen]
    for one, two in zip(plan.seen, table.seen, strict=True):
        np.testing.assert_allclose(one.smallest, two.smallest, rtol=1e-9)
    asked = {entry.effect for entry in plan.missing}
    assert {"base_drift:base", "tracker_drift:instrument", "thermal_expansion:arm"} <= asked


@pytest.mark.long
def test_markers_out_of_sight_tell_nothing(cell: Cell, found: PowerAnalysis) -> None:
    seen = found.data.seen.copy()
    seen[:, 1] = False
    part = foresee(cell, replace(found.data, seen=seen))
    assert part.detection.rows == 2 * found.detection.rows // 3
    whole = {s.key: s.smallest[s.lead] for s in found.seen}
    for cause in part.seen:
        assert cause.smallest[cause.lead] > 0.98 * whole[cause.key]


ROWS = 400


RNG = np.random.default_rng(3)


N = RNG.normal(size=(ROWS, 6))


FIRST = RNG.normal(size=ROWS)


X = np.column_stack(
    [
        FIRST,  # 0
        0.95 * FIRST + 0.3 * RNG.normal(size=ROWS),  # 1: much like it
        -3.0 * FIRST + N @ RNG.normal(size=6),  # 2: its twin, once N is projected out
        *RNG.normal(size=(2, ROWS)),  # 3, 4
    ]
)


CAUSES = [np.array([0]), np.array([1]), np.array([2]), np.array([0, 3, 4]), np.array([1, 4])]


DRAWS = [plausible(np.ones(len(own))) for own in CAUSES]


def gram(X_of: Array) -> Array:
    """Products of X_of with N projected out, by plain least squares."""
    left = X_of - N @ np.linalg.lstsq(N, X_of, rcond=None)[0]
    return np.asarray(left.T @ left)


ALIKE = likeness(gram(X), np.linalg.norm(X, axis=0), CAUSES, DRAWS)


def directions(left: Array, X_of: Array) -> Array:
    T, seen = visible_directions(left.T @ left, np.linalg.norm(X_of, axis=0))
    return np.asarray(left @ T[:, seen])


def simulated(e: int, f: int, noncentrality: float, trials: int = 4000) -> float:
    """Share of trials in which cause e, which is there, has the better score less its price."""
    rng = np.random.default_rng(e + 10 * f)
    left = X - N @ np.linalg.lstsq(N, X, rcond=None)[0]
    own, other = (directions(left[:, c], X[:, c]) for c in (CAUSES[e], CAUSES[f]))
    signal = left[:, CAUSES[e]] @ rng.normal(size=(len(CAUSES[e]), trials))
    signal *= np.sqrt(noncentrality) / np.linalg.norm(signal, axis=0)
    r = signal + rng.normal(size=signal.shape)

    def gain(U: Array) -> Array:
        return np.asarray(((U.T @ r) ** 2).sum(axis=0) - U.shape[1] * np.log(ROWS))

    return float(np.mean(gain(own) > gain(other)))


@pytest.mark.parametrize(("e", "f"), [(0, 1), (1, 0), (3, 4), (4, 3), (3, 1), (0, 3)])
@pytest.mark.parametrize("noncentrality", [30.0, 80.0])
def test_preference_is_that_of_simulated_choices(e: int, f: int, noncentrality: float) -> None:
    expected = ALIKE.preferred(np.full(len(CAUSES), noncentrality), ROWS)[e, f]
    assert simulated(e, f, noncentrality) == pytest.approx(expected, abs=0.03)


def test_what_is_left_is_that_of_least_squares() -> None:
    for e, f in ((0, 1), (1, 3), (0, 4)):
        signal = X[:, CAUSES[e]].sum(axis=1)
        both = np.column_stack([N, X[:, CAUSES[f]]])
        beside = signal - both @ np.linalg.lstsq(both, signal, rcond=None)[0]
        alone = signal - N @ np.linalg.lstsq(N, signal, rcond=None)[0]
        left = (beside @ beside) / (alone @ alone)
        (alone_left,) = likeness(
            gram(X), np.linalg.norm(X, axis=0), CAUSES, [np.ones((len(own), 1)) for own in CAUSES]
        ).left[e, f]
        assert alone_left == pytest.approx(left, rel=1e-9)
        if len(CAUSES[e]) == 1:
            np.testing.assert_allclose(ALIKE.left[e, f], left, rtol=1e-9)


def test_the_needed_size_is_told_apart_and_no_less() -> None:
    needed = ALIKE.needed(ROWS)
    for e, f in ((0, 1), (3, 4), (3, 1)):
        chance = ALIKE.preferred(np.where(np.isfinite(needed), needed, 1.0), ROWS)[e, f]
        assert chance == pytest.approx(SURE, abs=1e-6)
        assert simulated(e, f, float(needed[e, f])) == pytest.approx(SURE, abs=0.02)


def test_confounded_causes_are_never_told_apart() -> None:
    assert [tuple(np.flatnonzero(row)) for row in ALIKE.confounded[[0, 2]]] == [(0, 2), (0, 2)]
    assert not ALIKE.confounded[0, 1]
    needed = ALIKE.needed(ROWS)
    assert needed[0, 2] == needed[2, 0] == np.inf
    assert ALIKE.preferred(np.full(len(CAUSES), 1e4), ROWS)[0, 2] == pytest.approx(0.5)


def test_a_part_of_a_rival_is_told_from_it_by_its_price() -> None:
    """Cause 0 is one direction of cause 3: it costs less for the same, at any size."""
    assert ALIKE.needed(ROWS)[0, 3] == 0.0
    assert 0.0 < ALIKE.needed(ROWS)[3, 0] < np.inf


def test_the_most_useful_pose_is_that_of_all_rows_at_once() -> None:
    rng = np.random.default_rng(0)
    p, sizes, weights = 6, rng.uniform(0.5, 2.0, 6), rng.uniform(size=5)
    at = TargetErrors(rng.normal(size=(5, 3, p)), weights / weights.sum())
    own, more = rng.normal(size=(30, p)) / sizes, rng.normal(size=(4, 9, p)) / sizes

    def direct(*further: int) -> float:
        rows = np.concatenate([own, *(more[i] for i in further)]) * sizes
        cov = np.linalg.inv(rows.T @ rows + np.eye(p) / 100.0)
        return float(at.weights @ np.einsum("krp,pq,krq->k", at.rows, cov, at.rows))

    first, second, *_ = most_useful_first(at, own, more, sizes)
    assert first == np.argmin([direct(i) for i in range(4)])
    assert second == min(set(range(4)) - {first}, key=lambda i: direct(first, i))
