"""A right shape is seldom doubted; a wrong one is, with what its size varies with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis.shape import SHAPE_ALPHA, question, shape_doubt
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.model.build import context_of, place_effect
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from tests.calib.diagnosis.days import Day, measured_day, settling
from tests.calib.diagnosis.test_diagnose import measured
from tests.helpers import stage_of

DRAWS = 300
SIZES: dict[str, list[float]] = {
    "backlash:A3": [120e-6],
    "transmission_harmonic:A4": [150e-6, -100e-6, 50e-6, 0.0],
    "base_compliance:base": [6e-9, 6e-9],
}


@cache
def fitted(name: str) -> tuple[Stage, Fit, Effect]:
    """The right effect fitted to readings of a robot that has it."""
    cell, data, _ = measured(name, SIZES[name][: 1 if "base" in name else None], seed=4)
    return fit_of(cell, data, name)


def fit_of(cell: Cell, data: Measurements, name: str) -> tuple[Stage, Fit, Effect]:
    stage = stage_of(cell, data)
    kind, where = name.split(":")
    effect = place_effect(kind, where, context_of(cell, data.poses))
    return stage, stage.fit([effect]), effect


def read_anew(fit: Fit, rng: np.random.Generator, moved: Array) -> Fit:
    """What the fit leaves of other noise, and of what the model does not know, (m, rows)."""
    r, J = rng.normal(size=fit.r.shape) + moved, fit.J.reshape(-1, fit.J.shape[-1])
    N = J @ fit.span
    left = r.ravel() - N @ np.linalg.lstsq(N, r.ravel(), rcond=None)[0]
    return replace(fit, r=left.reshape(fit.r.shape))


@pytest.mark.long
@pytest.mark.parametrize(("name", "size"), [*((name, 1.0) for name in SIZES), ("backlash:A3", 1.6)])
def test_a_right_shape_is_doubted_in_three_of_a_hundred(name: str, size: float) -> None:
    stage, fit, effect = fitted(name)
    asked, rng = question(stage, fit, effect), np.random.default_rng(11)
    assert asked is not None
    r, J = fit.linear.independent
    Q, R = np.linalg.qr(J @ fit.span)
    assert np.abs(np.diag(R)).min() > 0.0
    doubted, counted = 0, np.abs(J).sum(axis=1) > 0.0
    for _ in range(DRAWS):
        r = size * rng.normal(size=len(r)) * counted
        rest = replace(asked.rest, left=r - Q @ (Q.T @ r))
        doubted += replace(asked, rest=rest).answer[1] < SHAPE_ALPHA
    # At most 9 are expected; 17 or more come once in a hundred times.
    assert doubted <= 16
    assert SHAPE_ALPHA <= 0.03


@pytest.mark.parametrize("name", ["backlash:A3", "transmission_harmonic:A4"])
def test_the_power_is_how_often_a_wrong_shape_is_doubted(name: str) -> None:
    """Of an effect whose size varies with its joint's angle by 35 %, at any phase."""
    asked, rng = question(*fitted(name)), np.random.default_rng(12)
    assert asked is not None
    k = next(i for i, m in enumerate(asked.asked) if m.depends_on == f"q:{name.split(':')[1]}")
    first, alpha = sum(m.centred.shape[1] for m in asked.asked[:k]), asked.asked[k].chance
    alpha, Q, wave = alpha * SHAPE_ALPHA, asked.rest.Q, asked.X[:, first : first + 2]
    counted, doubted = asked.X.any(axis=1), 0
    for _ in range(DRAWS):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        moved = wave @ (0.35 / np.sqrt(2.0) * np.array([np.cos(phase), np.sin(phase)]))
        r = rng.normal(size=len(counted)) * counted + moved
        rest = replace(asked.rest, left=r - Q @ (Q.T @ r))
        doubted += replace(asked, rest=rest).tested(k)[0] < alpha
    assert doubted / DRAWS == pytest.approx(asked.power_of(k, alpha), abs=0.08)


def by_angle(poses: Poses) -> Array:
    return np.asarray(np.sin(2.0 * poses.q[:, 2] + 0.7))


def by_move(poses: Poses) -> Array:
    assert poses.motion is not None
    return np.asarray(poses.motion[:, 2] / poses.motion[:, 2].mean() - 1.0)


def by_share(poses: Poses) -> Array:
    assert poses.motion is not None
    share = poses.motion[:, 2] / np.maximum(poses.motion.max(axis=1), 1e-9)
    return np.asarray(share / share.mean() - 1.0)


def by_time(poses: Poses) -> Array:
    return np.exp(-poses.elapsed / 1200.0)


def by_temperature(poses: Poses) -> Array:
    return np.asarray(poses.warming / 3.0)


def by_load(poses: Poses) -> Array:
    return np.asarray(np.where(poses.load_mass > 0.0, 0.5, -0.5))


@pytest.mark.parametrize(
    ("factor", "depends_on"),
    [
        (by_angle, "q:A3"),
        (by_move, "motion:A3"),
        (by_share, "motion:A3"),
        (by_time, "time"),
        (by_temperature, "temperature"),
        (by_load, "load"),
    ],
)
def test_a_wrong_shape_is_doubted_with_what_it_varies_with(
    factor: Callable[[Poses], Array], depends_on: str
) -> None:
    """Backlash whose size varies by half of itself."""
    stage, fit, effect = fitted("backlash:A3")
    rng = np.random.default_rng(2)
    own = fit.positions(effect)
    done = (fit.J[..., own] @ fit.values[own]).reshape(len(stage.data), -1)
    f = factor(stage.data.poses)
    moved = done * (0.5 * (f - f.mean()) / f.std())[:, None]
    doubts = [shape_doubt(stage, read_anew(fit, rng, moved), effect) for _ in range(6)]
    assert all(doubt.stands for doubt in doubts)
    assert [doubt.depends_on for doubt in doubts].count(depends_on) >= 5
    assert all(doubt.also_there for doubt in doubts)


def interleaved(*tables: Measurements) -> list[Measurements]:
    """Two tables that were read in turn, as parts of the one that they would have been."""
    q, time = (np.concatenate([getattr(t.poses, own) for t in tables]) for own in ("q", "time"))
    whole, count = with_moves(poses_at(q, time=time)), len(tables[0])
    parts = whole.take(slice(count)), whole.take(slice(count, None))
    return [
        replace(
            t,
            poses=replace(
                t.poses, approach=p.approach, motion=p.motion, start=p.start, order=p.order
            ),
        )
        for t, p in zip(tables, parts, strict=True)
    ]


def test_backlash_is_not_there_beside_a_servo_that_has_not_settled(
    settling_day: Day, tmp_path: Path
) -> None:
    for cell, *tables in (settling_day, measured_day(tmp_path, settling("elbow"), 2000.0, 2)):
        data, _ = interleaved(*tables)
        stage, fit, effect = fit_of(cell, data, "backlash:elbow")
        doubt = shape_doubt(stage, fit, effect)
        assert doubt.stands
        assert doubt.depends_on == "motion:elbow"
        assert not doubt.also_there


@pytest.mark.long
def test_a_servo_that_has_not_settled_is_named(settling_day: Day) -> None:
    cell, *tables = settling_day
    data, heldout = interleaved(*tables)
    found = calib.diagnose(cell, data, heldout=heldout)
    assert found.verdict == "explained"
    assert [c.named.candidate.key for c in found.causes] == ["settling:elbow"]


@pytest.mark.long
def test_a_lag_that_has_no_name_is_unknown_by_its_motion(settling_day: Day) -> None:
    """The same where the user rules settling out: what follows the move is no backlash either."""
    cell, *tables = settling_day
    data, heldout = interleaved(*tables)
    cell = replace(cell, excluded=("settling",))
    found = calib.diagnose(cell, data, heldout=heldout)
    assert found.verdict == "unknown"
    assert not found.causes
    assert (found.located[0].where, found.located[0].depends_on) == ("elbow", "motion:elbow")
