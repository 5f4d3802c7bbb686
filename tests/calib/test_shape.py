"""A right shape is seldom doubted; a wrong one is, with what its size varies with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis.functions import pose_variables
from calib.diagnosis.shape import SHAPE_ALPHA, chance_of, question, shape_doubt
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.model.build import context_of, place_effect
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from tests.day import Sizes, day
from tests.helpers import stage_of

DRAWS = 100


SIZES: dict[str, Sizes] = {
    "backlash:A3": 120e-6,
    "transmission_harmonic:A4": (150e-6, -100e-6, 50e-6, 0.0),
    "base_compliance:base": 6e-9,
}


@cache
def fitted(name: str) -> tuple[Stage, Fit, Effect]:
    """The right effect fitted to readings of a robot that has it."""
    cell, data, _, _ = day("kr270", name, SIZES[name], seed=4)
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
    # At most 3 are expected; eight or more come once in a hundred times.
    assert doubted <= 7
    assert SHAPE_ALPHA <= 0.03


def _moves(poses: Poses) -> Array:
    return np.asarray(poses.motion)[:, 2]


FACTORS: dict[str, tuple[Callable[[Poses], Array], str]] = {
    "angle": (lambda poses: np.sin(2.0 * poses.q[:, 2] + 0.7), "q:A3"),
    "move": (_moves, "motion:A3"),
    "share of the move": (
        lambda poses: _moves(poses) / np.maximum(np.max(poses.motion, axis=1), 1e-9), "motion:A3"
    ),
    "time": (lambda poses: np.exp(-poses.elapsed / 1200.0), "time"),
    "temperature": (lambda poses: poses.warming, "temperature"),
    "load": (lambda poses: poses.load_mass > 0.0, "load"),
}  # fmt: skip


@pytest.mark.parametrize("by", FACTORS)
def test_a_wrong_shape_is_doubted_with_what_it_varies_with(by: str) -> None:
    """Backlash whose size varies by half of itself."""
    (factor, depends_on), (stage, fit, effect) = FACTORS[by], fitted("backlash:A3")
    rng = np.random.default_rng(2)
    own = fit.positions(effect)
    done = (fit.J[..., own] @ fit.values[own]).reshape(len(stage.data), -1)
    f = np.asarray(factor(stage.data.poses), dtype=float)
    moved = done * (0.5 * (f - f.mean()) / f.std())[:, None]
    doubts = [shape_doubt(stage, read_anew(fit, rng, moved), effect) for _ in range(6)]
    assert all(doubt.stands for doubt in doubts)
    assert [doubt.depends_on for doubt in doubts].count(depends_on) >= 5
    assert all(doubt.also_there for doubt in doubts)


def test_the_chance_of_a_false_doubt_is_shared_out(kr270: Cell) -> None:
    """Over the angles of all joints; the rest is for what else is known of the readings."""
    robot = kr270.robot
    for where in ("A3", "base"):
        assert sum(chance_of(robot, joint, where) for joint in robot.joints) == pytest.approx(0.75)


def test_a_move_counts_with_the_side_from_which_the_joint_came(kr270: Cell) -> None:
    poses = with_moves(poses_at(kr270.robot.sobol(20)))
    moved = pose_variables(kr270.robot, poses)["motion:A3"].at(poses)
    np.testing.assert_allclose(moved[1:], np.diff(poses.q[:, 2]), atol=1e-12)


def settling(noncentrality: float, seed: int) -> tuple[Cell, list[Measurements]]:
    """The elbow is read before it was at rest; two tables that were read in turn."""
    cell, *tables, _ = day("light", "settling:elbow", noncentrality, seed=seed)
    q, time = (np.concatenate([getattr(t.poses, own) for t in tables]) for own in ("q", "time"))
    whole, count = with_moves(poses_at(q, time=time)), len(tables[0])
    parts = whole.take(slice(count)), whole.take(slice(count, None))
    moves = (
        "approach",
        "motion",
        "start",
        "order",
    )  # as of the one table that they would have been
    return cell, [
        replace(table, poses=replace(table.poses, **{own: getattr(part, own) for own in moves}))
        for table, part in zip(tables, parts, strict=True)
    ]


@pytest.mark.parametrize(("noncentrality", "seed"), [(600.0, 1), (2000.0, 2)])
def test_backlash_is_not_there_beside_a_servo_that_has_not_settled(
    noncentrality: float, seed: int
) -> None:
    cell, (data, _) = settling(noncentrality, seed)
    stage, fit, effect = fit_of(cell, data, "backlash:elbow")
    doubt = shape_doubt(stage, fit, effect)
    assert doubt.stands
    assert doubt.depends_on == "motion:elbow"
    assert not doubt.also_there


@pytest.mark.long
@pytest.mark.parametrize("excluded", [(), ("settling",)])
def test_a_servo_that_has_not_settled_is_named_or_unknown_by_its_motion(
    excluded: tuple[str, ...],
) -> None:
    """Where the user rules settling out, what follows the move is no backlash either."""
    cell, (data, heldout) = settling(600.0, 1)
    found = calib.diagnose(replace(cell, excluded=excluded), data, heldout=heldout)
    named = [c.named.candidate.key for c in found.causes]
    if not excluded:
        assert (found.verdict, named) == ("explained", ["settling:elbow"])
        return
    assert (found.verdict, named) == ("unknown", [])
    assert (found.located[0].where, found.located[0].depends_on) == ("elbow", "motion:elbow")
