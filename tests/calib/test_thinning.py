"""Long tables made shorter: evenly, from every stay, and with nothing that they say lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.diagnosis import part
from calib.model.build import build
from calib.poses import Measurements, poses_at
from calib.poses.moves import thinned, visits, with_moves
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot

ROBOT = random_robot(np.random.default_rng(1), 6)
CELL = cell_of(ROBOT, np.array([[0.2, 0.0, 0.05]]), ("base", "tool", "joint_offset"))


def stays(*counts: int, scale: float = 0.0) -> Measurements:
    """An arm that waits at each pose for so many readings; joint 2 turns too far by a share."""
    rng = np.random.default_rng(2)
    q = np.repeat(rng.uniform(-1.5, 1.5, (len(counts), 6)), counts, axis=0)
    poses = with_moves(poses_at(q))
    model = build(CELL, poses).model
    true = replace(poses, q=q * (1.0 + scale * np.eye(6)[1]))
    data = drawn_readings(model, model.initial, true, CELL.noise, rng)
    return replace(data, poses=poses)


def readings_of_stays(data: Measurements) -> list[int]:
    return np.unique(visits(data.poses), return_counts=True)[1].tolist()


def apart(own: Measurements, data: Measurements) -> np.ndarray:
    """How many readings lie between those that are kept."""
    return np.diff([data.poses.names.index(name) for name in own.poses.names])


def test_every_stay_keeps_as_many_and_evenly() -> None:
    few = stays(5, 5)
    assert thinned(few, 10) == (few, ())
    data = stays(100, 3, 50, 1)
    own, said = thinned(data, 44)
    assert readings_of_stays(own) == [20, 3, 20, 1]
    assert apart(own, data)[:19].tolist() == [5] * 19
    assert said == ("44 of 154 readings were used, the same number at each stop of the arm",)


@pytest.mark.parametrize("most", [1, 7, 13])
def test_more_stays_than_room_are_taken_evenly(most: int) -> None:
    data = stays(*[2] * 30)
    own, said = thinned(data, most)
    assert len(own) == most
    assert {*apart(own, data)} <= {2 * (30 // most), 2 * -(-30 // most)}
    assert said == (f"{most} of 60 readings were used, spread evenly over all",)


def test_order_of_measurement_and_not_of_the_file_counts() -> None:
    data = stays(6, 6)
    timed = replace(data, poses=replace(data.poses, time=np.arange(12.0)))
    own, _ = thinned(timed.take(np.random.default_rng(0).permutation(12)), 4)
    assert readings_of_stays(own) == [2, 2]


def test_of_a_large_table_a_part_is_diagnosed_and_the_rest_is_held_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own, rest, said = part.part_of(stays(*[3] * 3000))  # readings of a stay are no held-out poses
    assert (len(own), len(rest)) == (3000, 0)
    assert said[0].endswith("1.7 times smaller")
    monkeypatch.setattr(part, "_NUMBERS", 120)
    monkeypatch.setattr(part, "_LEAST", 10)
    found = calib.diagnose(CELL, stays(*[1] * 60, scale=1e-3))
    names = [{*data.poses.names} for data in (found.data, found.heldout)]
    assert (len(names[0]), len(names[1])) == (40, 20)
    assert not names[0] & names[1]
    assert (found.gap.heldout_after or 1.0) < 0.2 * (found.gap.heldout_before or 0.0)
    assert found.warnings == (
        "40 of 60 readings were used, spread evenly over all; all of them would show errors 1.2 times "
        "smaller; 20 at other configurations were held out",
    )


def test_an_identification_of_a_part_is_that_of_the_whole() -> None:
    data = stays(*[30] * 40)
    whole, part = (calib.identify(CELL, own) for own in (data, thinned(data, 400)[0]))
    shown = part.std > 0.0
    off = np.abs(whole.values - part.values)[shown] / part.std[shown]
    assert off.max() < 3.0
    np.testing.assert_allclose(part.std[shown], np.sqrt(3.0) * whole.std[shown], rtol=0.1)
