"""What a plan is said to see, against diagnoses, least squares and simulated choices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.inference.evidence import score_test
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from doe.forecast.accuracy import most_useful_first
from doe.forecast.foresee import PowerAnalysis, foresee
from tests.day import MODEL, free_and_loaded
from tests.helpers import all_seen, cell_of, random_robot, with_effects


def session(cell: Cell, count: int) -> Poses:
    return free_and_loaded(np.random.default_rng(0), cell, count)


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *MODEL), load=None)


@pytest.fixture(scope="module")
def found(cell: Cell) -> PowerAnalysis:
    return foresee(cell, session(cell, 30))


def keys(found: PowerAnalysis, positions: tuple[int, ...]) -> set[str]:
    return {found.seen[i].key for i in positions}


def columns(found: PowerAnalysis, key: str) -> np.ndarray:
    return found.beside.columns[[c.key for c in found.causes].index(key)]


@pytest.mark.long
def test_a_smallest_size_is_found_nine_times_in_ten(found: PowerAnalysis) -> None:
    rng = np.random.default_rng(1)
    for key in ("backlash:A5", "transmission_harmonic:A2", "base_drift:base", "payload:payload"):
        cause = next(s for s in found.seen if s.key == key)
        own = columns(found, key)
        X, lengths = found.beside.left[:, own], np.linalg.norm(found.beside.X[:, own], axis=0)
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
    """Stated sizes have the stated noncentrality by plain least squares on what is left."""
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
        for cause in (s for s in seen.seen if s.key in ("backlash:j2", "joint_offset:j3")):
            columns = calib.observation(with_effects(cell, "base", "tool", cause.key), poses)[
                first:
            ]
            rows = columns.reshape(-1, columns.shape[-1]) / cell.noise.across
            N, signal = rows[:, :-1], rows[:, -1] * cause.smallest[0]
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
    rows = [np.count_nonzero(own.beside.X.any(axis=1)) for own in (part, found)]
    assert rows[0] == 2 * rows[1] // 3
    whole = {s.key: s.smallest[s.lead] for s in found.seen}
    for cause in part.seen:
        assert cause.smallest[cause.lead] > 0.98 * whole[cause.key]


def test_what_a_cause_leaves_beside_another_is_that_of_least_squares(found: PowerAnalysis) -> None:
    """Of causes of one parameter the part that is imitated, by plain least squares on both."""
    single = [i for i, cause in enumerate(found.seen) if len(cause.parameters) == 1][:4]
    N = found.beside.modelled / np.linalg.norm(found.beside.modelled, axis=0)
    for i in single:
        x = found.beside.X[:, columns(found, found.seen[i].key)][:, 0]
        alone = x - N @ np.linalg.lstsq(N, x, rcond=None)[0]
        for j in single:
            both = np.column_stack([N, found.beside.X[:, columns(found, found.seen[j].key)]])
            both = both / np.linalg.norm(both, axis=0)
            beside = x - both @ np.linalg.lstsq(both, x, rcond=None)[0]
            left = float((beside @ beside) / (alone @ alone))
            assert 1.0 - found.rho[i, j] ** 2 == pytest.approx(left, abs=1e-6)
            if i != j:
                assert found.times[i, j] == pytest.approx(left**-0.5, rel=1e-3)


def test_the_most_useful_pose_is_that_of_all_rows_at_once() -> None:
    rng = np.random.default_rng(0)
    p, sizes, weights = 6, rng.uniform(0.5, 2.0, 6), rng.uniform(size=5)
    at, weights = rng.normal(size=(5, 3, p)), weights / weights.sum()
    half = (at * np.sqrt(weights)[:, None, None]).reshape(-1, p)
    own, more = rng.normal(size=(30, p)) / sizes, rng.normal(size=(4, 9, p)) / sizes

    def direct(*further: int) -> float:
        rows = np.concatenate([own, *(more[i] for i in further)]) * sizes
        cov = np.linalg.inv(rows.T @ rows + np.eye(p) / 100.0)
        return float(weights @ np.einsum("krp,pq,krq->k", at, cov, at))

    first, second, *_ = most_useful_first(half, own, more, sizes)
    assert first == np.argmin([direct(i) for i in range(4)])
    assert second == min(set(range(4)) - {first}, key=lambda i: direct(first, i))
