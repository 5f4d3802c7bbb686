"""Velocities of a filmed arm follow from its path; of one that stood still there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves


def filmed(time: Array) -> tuple[Poses, Array]:
    phase = np.column_stack([0.3 * time, 0.2 * time + 1.0])
    return poses_at(np.sin(phase), time=time), np.cos(phase) * [0.3, 0.2]


def test_a_path_has_velocities_where_images_are_missing_too() -> None:
    time = np.linspace(0.0, 20.0, 60)
    time = np.delete(time, [20, 21, 40])
    poses, true = filmed(time)
    found = with_moves(poses.take(np.random.default_rng(0).permutation(len(time))))
    assert found.velocity is not None
    at = np.argsort(found.time if found.time is not None else [])
    np.testing.assert_allclose(found.velocity[at], true, atol=2e-3)


def test_the_way_from_one_day_to_the_next_is_no_path() -> None:
    poses, true = filmed(np.linspace(0.0, 20.0, 60))
    day = np.repeat(["a", "b"], 30)
    q = poses.q + np.where(day == "b", 2.0, 0.0)[:, None]
    found = with_moves(replace(poses, q=q, session=day))
    assert found.velocity is not None
    np.testing.assert_allclose(found.velocity, true, atol=5e-3)


@pytest.mark.parametrize("timed", [True, False])
def test_chosen_stops_have_none(timed: bool) -> None:
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (40, 6))
    poses = poses_at(q, time=60.0 * np.arange(40.0)) if timed else poses_at(q)
    assert with_moves(poses).velocity is None


def test_an_arm_that_never_moves_has_none() -> None:
    assert with_moves(poses_at(np.zeros((10, 6)))).velocity is None


def test_what_a_table_states_is_kept() -> None:
    poses, true = filmed(np.linspace(0.0, 20.0, 60))
    assert with_moves(replace(poses, velocity=2.0 * true)).velocity is not None
    np.testing.assert_array_equal(
        with_moves(replace(poses, velocity=2.0 * true)).velocity, 2.0 * true
    )
