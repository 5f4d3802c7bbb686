"""What is fitted does not depend on what is held out; held-out poses know what came before them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Poses, poses_at
from calib.poses.moves import in_one_session, with_moves
from calib.simulation import drawn_readings
from tests.calib.poses.test_moves import as_data
from tests.helpers import cell_of, random_robot, with_effects

DAYS = np.array(["Mon", "Tue", "Wed"])


def same(a: Poses, b: Poses) -> None:
    for field in fields(Poses):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), field.name)


def drawn(rng: np.random.Generator, m: int, timed: bool, days: bool) -> Poses:
    """Poses anyhow: repeated joints, gaps of hours, days whose clock begins again."""
    q = rng.integers(-2, 3, (m, 3)) * 0.3
    time = np.cumsum(rng.choice([20.0, 60.0, 5000.0], m, p=[0.5, 0.4, 0.1]))
    day = np.sort(rng.integers(0, 3, m)) if days else np.zeros(m, dtype=int)
    time = time - (time[np.searchsorted(day, day)] if rng.random() < 0.5 else 0.0)
    shuffled = rng.permutation(m)
    return poses_at(
        q[shuffled],
        time=time[shuffled] if timed else None,
        session=DAYS[day[shuffled]] if days else None,
    )


@pytest.mark.parametrize("seed", range(16))
def test_no_table_held_out_changes_what_is_fitted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    timed, days = bool(seed % 2), bool(seed // 2 % 2)
    whole = drawn(rng, 30, timed, days)
    fitted = as_data(with_moves(whole.take(np.arange(20))))
    for size in (1, 4, 10):
        own = 20 + rng.permutation(10)[:size]
        held = as_data(with_moves(whole.take(own)))
        data, out = in_one_session(fitted, held)
        same(data.poses, fitted.poses)
        if timed:
            told = with_moves(whole.take(np.concatenate([np.arange(20), own]))).take(
                slice(20, None)
            )
            np.testing.assert_array_equal(out.poses.approach, told.approach)
            np.testing.assert_array_equal(out.poses.motion, told.motion)
            np.testing.assert_array_equal(out.poses.time, held.poses.time)
            assert out.poses.start == fitted.poses.start
        same(in_one_session(data, out)[1].poses, out.poses)


@pytest.mark.parametrize("seed", range(10))
def test_parts_of_one_table_keep_the_moves_of_the_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = as_data(with_moves(drawn(rng, 30, bool(seed % 2), bool(seed // 2 % 2))))
    parts = whole.split(0.3, rng)
    for part, alone in zip(in_one_session(*parts), parts, strict=True):
        same(part.poses, alone.poses)


def day(rng: np.random.Generator) -> tuple[Cell, Measurements, Measurements]:
    """Two tables that were read in turn, of an arm with lost motion that its model lacks."""
    cell = cell_of(random_robot(rng, 4), rng.uniform(-0.2, 0.2, (3, 3)), ("base", "tool"))
    low, high = cell.robot.sample_limits().T
    poses = poses_at(rng.uniform(low, high, (60, 4)), time=60.0 * np.arange(60.0))
    truth = with_effects(cell, "base", "tool", "backlash:j3")
    model = build(truth, with_moves(poses)).model
    values = np.zeros(len(model.parameters))
    values[-1] = 2e-4
    whole = drawn_readings(model, values, with_moves(poses), Noise.isotropic(2e-5), rng)
    own = np.isin(np.arange(60), rng.permutation(60)[:20])

    def table(chosen: Array) -> Measurements:
        bare = poses.take(chosen)
        return replace(whole.take(chosen), poses=with_moves(bare))

    return cell, table(~own), table(own)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(2))
def test_estimate_and_diagnosis_are_the_same_to_the_last_digit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell, data, held = day(rng)
    lossy = with_effects(cell, "base", "tool", "backlash:j3")
    alone, found = calib.identify(lossy, data), calib.diagnose(cell, data)
    scrambled = replace(held, readings=rng.permuted(held.readings, axis=0))
    for other in (held, held.take(slice(5)), scrambled):
        own, out = calib.in_one_session(data, other)
        beside = calib.identify(lossy, own, heldout=out)
        np.testing.assert_array_equal(beside.values, alone.values)
        np.testing.assert_array_equal(beside.covariance, alone.covariance)
        np.testing.assert_array_equal(beside.fit.vectors, alone.fit.vectors)
        again = calib.diagnose(cell, data, heldout=other)
        # What scrambled readings err by is no chance: it remains, and verdict and places say so.
        more = other is scrambled
        assert again.verdict == found.verdict or (more and again.verdict == "unknown")
        assert again.located[: len(found.located)] == found.located
        assert more or len(again.located) == len(found.located)
        assert [c.named.candidate.key for c in again.causes] == [
            c.named.candidate.key for c in found.causes
        ]
        assert again.refused == found.refused
        np.testing.assert_array_equal(again.after.values, found.after.values)
        np.testing.assert_array_equal(again.outlier, found.outlier)
    assert again.gap.heldout_rose is not None or not again.causes


def test_held_out_poses_that_speak_against_it_decide_nothing() -> None:
    rng = np.random.default_rng(5)
    cell, data, held = day(rng)
    found = calib.diagnose(cell, data, heldout=held)
    assert found.gap.heldout_rose is False
    lost = build(with_effects(cell, "base", "tool", "backlash:j3"), held.poses).model
    values = np.append(found.before.values[: len(lost.parameters) - 1], -2e-4)
    _, out = in_one_session(data, held)
    opposite = replace(held, readings=lost.predict(values, out.poses))
    told = calib.diagnose(cell, data, heldout=opposite)
    assert told.gap.heldout_rose is True
    assert [c.named.candidate.key for c in told.causes] == [
        c.named.candidate.key for c in found.causes
    ]
    assert told.verdict == found.verdict
