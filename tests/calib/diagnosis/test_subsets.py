"""Names in the place of a curve: where they make it up, and never where nothing in the list does."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.diagnosis.candidates import candidates
from calib.diagnosis.lineup import lineup
from calib.diagnosis.screen import Field, Score, field, score
from calib.diagnosis.stepwise import ALPHA
from calib.diagnosis.subsets import names_for_curve
from calib.poses import poses_at
from calib.poses.moves import with_moves
from tests.helpers import all_seen, cell_of, light_chain, stage_of

ROWS, KNOTS, ASKED = 240, 10, 100


def pays(found: Score) -> bool:
    return bool(found.gain > 2.0 * np.log(ASKED) and found.p * ASKED < ALPHA)


def hats(v: Array) -> Array:
    """Lines between knots, shape (N, K)."""
    knots = np.linspace(v.min(), v.max(), KNOTS)
    return np.column_stack([np.interp(v, knots, row) for row in np.eye(KNOTS)])


def catalogue(v: Array, rng: np.random.Generator) -> list[Array]:
    """Causes that are functions of the curve's variable, and others of something else."""
    of_it = [v, np.abs(v), np.sign(v), np.stack([np.cos(v), np.sin(v)], -1).T, v**2]
    others = [rng.normal(size=len(v)) for _ in range(40)]
    return [np.atleast_2d(columns).T for columns in (*of_it, *others)]


def asked(error: Array, v: Array, seed: int) -> tuple[int, ...]:
    """What is preferred to a curve over v where an error (N,) is read with unit noise."""
    rng = np.random.default_rng(seed)
    columns = [hats(v), *catalogue(v, rng)]
    ends = np.cumsum([0, *(c.shape[1] for c in columns)])
    own = [np.arange(a, b) for a, b in pairwise(ends)]
    N = np.stack([np.ones_like(v), rng.normal(size=len(v))], axis=-1)
    beside = field(N, np.column_stack(columns), error + rng.normal(size=len(v)))
    spread = np.exp(-np.abs(np.subtract.outer(np.arange(KNOTS), np.arange(KNOTS))) / (KNOTS / 2))
    assert pays(score(beside, own[0], spread))
    return names_for_curve(beside, own[0], spread, own[1:], pays)


def variable(seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-3.0, 3.0, ROWS)


@pytest.mark.parametrize(
    ("members", "shape"),
    [
        ((0,), lambda v: 1.5 * v),
        ((2,), lambda v: 2.0 * np.sign(v)),
        ((0, 2), lambda v: 2.0 * v - 3.0 * np.sign(v)),
        ((1, 3), lambda v: 3.0 * np.abs(v) + 4.0 * np.sin(v + 0.4)),
        ((0, 2, 4), lambda v: 2.0 * v - 4.0 * np.sign(v) + 2.0 * v**2),
    ],
)
def test_causes_that_make_up_a_curve_are_preferred_to_it(
    members: tuple[int, ...], shape: object
) -> None:
    assert callable(shape)
    for seed in range(5):
        v = variable(seed)
        assert tuple(sorted(asked(shape(v), v, seed))) == members


@pytest.mark.sampled
@pytest.mark.parametrize("size", [2.5, 5.0])
@pytest.mark.parametrize(
    "shape",
    [
        lambda v: np.exp(-0.5 * ((v - 0.8) / 0.3) ** 2),
        lambda v: np.sin(4.0 * v + 0.5),
        lambda v: v > 1.3,
    ],
    ids=["a bump", "four waves", "a step elsewhere"],
)
def test_a_cause_that_is_in_no_list_stays_without_a_name(shape: object, size: float) -> None:
    assert callable(shape)
    named = 0
    for seed in range(20):
        v = variable(100 + seed)
        named += bool(asked(size * shape(v), v, seed))
    assert named == 0


FIRST, SECOND = 0.325, 0.275  # m, lengths of the SCARA's links


def scara() -> Robot:
    origins = np.tile(np.eye(4), (5, 1, 1))
    origins[[0, 1, 2], [2, 0, 0], 3] = 0.4, FIRST, SECOND
    limits = np.array([[-2.2, 2.2], [-2.4, 2.4], [-0.2, 0.0], [-3.1, 3.1]])
    return replace(light_chain(origins, limits, (2,)), joints=("J1", "J2", "Z", "J4"))


def read(q: Array, lift: Array, markers: Array, rng: np.random.Generator) -> Array:
    """Points of a SCARA that is lifted too far, by plain trigonometry, shape (m, M, 3), m."""
    turn = q[:, [0, 1, 3]].sum(axis=1)
    x = FIRST * np.cos(q[:, 0]) + SECOND * np.cos(q[:, 0] + q[:, 1])
    y = FIRST * np.sin(q[:, 0]) + SECOND * np.sin(q[:, 0] + q[:, 1])
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    points = np.stack(
        [
            x[:, None] + c * markers[:, 0] - s * markers[:, 1],
            y[:, None] + s * markers[:, 0] + c * markers[:, 1],
            (0.4 + q[:, 2] + lift)[:, None] + markers[:, 2],
        ],
        axis=-1,
    )
    return np.asarray(points + 1e-5 * rng.normal(size=points.shape))


def of_the_curve_that_leads(error: object, seed: int) -> tuple[str, list[str]]:
    """The curve at Z that explains most of an error of the lift, and what is preferred to it."""
    assert callable(error)
    rng, robot = np.random.default_rng(seed), scara()
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (50, 4))
    q[:, 2] = rng.choice([-0.2, 0.0], 50)
    markers = np.array([[0.08, 0.0, -0.05], [-0.05, 0.06, 0.0], [-0.03, -0.07, 0.04]])
    cell: Cell = cell_of(robot, markers, ("base", "tool", "geometry"))
    points = read(q, error(q), markers, rng)
    data = all_seen(with_moves(poses_at(q)), points)
    stage = stage_of(cell, data)
    suspects, _ = candidates(cell, stage.model, data)
    fit = stage.fit(())
    linear = stage.about(fit, [c.effect for c in suspects])
    view, _ = lineup(linear, suspects).seen_from(linear, fit, (), fresh=True)
    suspects = list(view.suspects)
    beside: Field = view.by_instrument.complement
    where: dict[str, IntArray] = view.where
    curves = [c for c in suspects if not c.named and c.where == "Z"]
    first = max(curves, key=lambda c: score(beside, where[c.key], c.spread).gain)
    assert first.spread is not None
    named = [c for c in suspects if c.named]
    found = names_for_curve(
        beside, where[first.key], first.spread, [where[c.key] for c in named], pays
    )
    return first.key, sorted(named[i].key for i in found)


def test_a_coupling_and_a_long_screw_are_not_a_curve() -> None:
    """Measured at the ends of the screw alone, where its error looks like lost motion as well."""
    for seed in range(3):
        _, found = of_the_curve_that_leads(lambda q: 3e-5 * q[:, 3] + 5e-4 * q[:, 2], seed)
        assert "joint_coupling:Z" in found
        assert len(found) == 2


def test_a_spindle_that_sticks_has_no_name() -> None:
    for seed in range(3):
        _, found = of_the_curve_that_leads(lambda q: 2e-4 * (np.sin(5.0 * q[:, 3]) > 0.5), seed)
        assert found == []
