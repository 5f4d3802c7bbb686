"""What outliers have in common: its chance against shuffled outliers, simulated days, real arms."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.identification.pattern import SURELY, Shared, Variable, shared, variables_of, within
from calib.poses import poses_at
from tests.calib.identification.test_real_data import result
from tests.helpers import all_seen, cell_of, light_chain


@pytest.mark.parametrize(("n", "k", "c", "s"), [(9, 3, 3, 4), (9, 4, 2, 3), (10, 5, 4, 5)])
def test_chance_is_that_of_all_draws(n: int, k: int, c: int, s: int) -> None:
    """Counted over every subset; the first c of the ordered draws stand for any c neighbours."""
    hits = [own[c - 1] - own[0] < s for own in combinations(range(n), k)]
    assert within(n, k, c, s) == pytest.approx(np.mean(hits), rel=1e-9)


def names(values: Array) -> tuple[Variable, ...]:
    return tuple(Variable(f"q:j{k}", column, "deg", 1.0) for k, column in enumerate(values.T))


def test_outliers_by_chance_share_nothing() -> None:
    rng = np.random.default_rng(0)
    found = 0
    for _ in range(600):
        n = int(rng.integers(30, 200))
        variables = names(rng.uniform(size=(n, 6)))
        out = np.zeros(n, dtype=bool)
        out[rng.permutation(n)[: int(rng.integers(2, 12))]] = True
        share = shared(variables, out)
        found += share is not None and not share.alone
    assert found <= 600 * SURELY + 3.0 * np.sqrt(600 * SURELY)


def test_a_pose_far_beyond_all_others() -> None:
    rng = np.random.default_rng(3)
    values = rng.uniform(-1.0, 1.0, (40, 3))
    values[7, 1] = 2.0
    out = np.arange(40) == 7
    found = shared(names(values), out)
    assert found is not None
    assert (found.variable, found.low, found.inside) == ("q:j1", 2.0, 1)
    assert found.alone == pytest.approx(2.0 - np.sort(values[:, 1])[-2])
    assert shared(names(values), np.arange(40) == 8) is None


# -- days with a truth of their own ------------------------------------------------------------


def planar(q: Array) -> Array:
    """Points of three markers on a planar arm of three links, (m, 3, 3), m: plain trigonometry."""
    angle = np.cumsum(q, axis=1)
    links, reach = np.array([0.6, 0.5, 0.2]), []
    for along, up in ((0.0, 0.0), (0.1, 0.05), (-0.05, 0.12)):
        x = (links * np.cos(angle)).sum(axis=1)
        y = (links * np.sin(angle)).sum(axis=1)
        last = angle[:, -1]
        x = x + along * np.cos(last) - up * np.sin(last)
        y = y + along * np.sin(last) + up * np.cos(last)
        reach.append(np.stack([x, y, np.full(len(q), 0.3)], axis=-1))
    return np.stack(reach, axis=1)


def day(points: Array, q: Array, seed: int) -> calib.Identification:
    origins = np.tile(np.eye(4), (4, 1, 1))
    origins[1:, 0, 3] = 0.6, 0.5, 0.2
    origins[0, 2, 3] = 0.3
    robot = light_chain(origins, np.tile([-np.pi, np.pi], (3, 1)))
    markers = np.array([[0.0, 0.0, 0.0], [0.1, 0.05, 0.0], [-0.05, 0.12, 0.0]])
    cell = cell_of(robot, markers, ("base", "joint_offset:j2,j3"))
    noise = 1e-5 * np.random.default_rng(seed).normal(size=points.shape)
    return calib.identify(cell, all_seen(poses_at(q), points + noise))


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_that_sags_in_one_part_of_its_range(seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, (100, 3))
    bad = (q[:, 1] > 1.2) & (q[:, 1] < 1.45)
    result = day(planar(q + np.outer(bad * 1e-3, [0.0, 1.0, 0.0])), q, seed)
    assert result.shared is not None
    assert result.shared.variable == "q:j2"
    assert 1.2 < result.shared.low < result.shared.high < 1.45
    assert any("outliers have j2 in" in text for text in result.warnings)
    assert result.shared.unit == "deg"
    assert result.shared.low / result.shared.scale == pytest.approx(np.degrees(result.shared.low))
    assert result.shared.p < SURELY


@pytest.mark.parametrize("seed", range(3))
def test_gross_errors_anywhere_share_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (100, 3))
    points = planar(q)
    points[rng.permutation(100)[:8]] += rng.normal(size=(8, 1, 3)) * 2e-3
    result = day(points, q, seed)
    assert 6 <= result.fit.outlier.sum() <= 9
    assert result.shared is None


# -- real arms ---------------------------------------------------------------------------------


def worst_of(data: Path, name: str, count: int) -> Shared | None:
    """What the poses with the largest residuals share, whatever judges them."""
    found = result(data, name)
    error = np.linalg.norm(found.fit.vectors, axis=(1, 2))
    variables = variables_of(found.model.robot, found.fit.data)
    return shared(variables, error >= np.sort(error)[-count])


def test_worst_poses_of_the_irb120_stand_together(data: Path) -> None:
    found = worst_of(data, "irb120_faro", 13)
    assert found is not None
    assert found.variable == "q:joint_2"
    assert -1.55 < found.low < found.high < -0.45
    assert found.p < 1e-6


def test_worst_pose_of_the_fanuc_is_the_only_one_there(data: Path) -> None:
    found = worst_of(data, "fanuc_r2000", 1)
    assert found is not None
    assert found.variable == "q:joint_2"
    assert np.degrees(found.low) == pytest.approx(50.0)
    assert found.alone > 0.0
