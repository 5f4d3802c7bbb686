"""Long tables made shorter: evenly, from every stay, and with nothing that they say lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.diagnosis import part
from calib.diagnosis.diagnose import diagnose
from calib.model.build import build
from calib.poses import Measurements, poses_at
from calib.poses.moves import thinned, visits, with_moves
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot

MARKER = np.array([[0.2, 0.0, 0.05]])


ROBOT = random_robot(np.random.default_rng(1), 6)


CELL = cell_of(ROBOT, MARKER, ("base", "tool", "joint_offset"))


def stays(*counts: int, scale: float = 0.0) -> Measurements:
    """An arm that waits at each pose for so many readings; joint 2 turns too far by a share."""
    rng = np.random.default_rng(2)
    poses = with_moves(
        poses_at(np.repeat(rng.uniform(-1.5, 1.5, (len(counts), 6)), counts, axis=0))
    )
    model = build(CELL, poses).model
    true = replace(poses, q=poses.q * np.array([1.0, 1.0 + scale, 1.0, 1.0, 1.0, 1.0]))
    data = drawn_readings(model, model.initial, true, CELL.noise, rng)
    return replace(data, poses=poses)


def readings_of_stays(data: Measurements) -> list[int]:
    return np.unique(visits(data.poses), return_counts=True)[1].tolist()


def test_few_readings_stay_as_they_are() -> None:
    data = stays(5, 5)
    assert thinned(data, 10) == (data, ())


def test_every_stay_keeps_as_many_and_evenly() -> None:
    data = stays(100, 3, 50, 1)
    own, said = thinned(data, 44)
    assert readings_of_stays(own) == [20, 3, 20, 1]
    kept = [data.poses.names.index(name) for name in own.poses.names]
    assert np.diff(kept[:20]).tolist() == [5] * 19
    assert said == ("44 of 154 readings were used, the same number at each stop of the arm",)


@pytest.mark.parametrize("most", [1, 7, 13])
def test_more_stays_than_room_are_taken_evenly(most: int) -> None:
    data = stays(*[2] * 30)
    own, said = thinned(data, most)
    assert len(own) == most
    kept = [data.poses.names.index(name) for name in own.poses.names]
    assert set(np.diff(kept)) <= {2 * (30 // most), 2 * -(-30 // most)}
    assert said == (f"{most} of 60 readings were used, spread evenly over all",)


def test_order_of_measurement_and_not_of_the_file_counts() -> None:
    data = stays(6, 6)
    shuffled = np.random.default_rng(0).permutation(12)
    timed = replace(data, poses=replace(data.poses, time=np.arange(12.0)))
    own, _ = thinned(timed.take(shuffled), 4)
    assert readings_of_stays(own) == [2, 2]


def test_of_a_large_table_a_part_is_diagnosed_and_the_rest_is_held_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(part, "_NUMBERS", 120)
    monkeypatch.setattr(part, "_LEAST", 10)
    data = stays(*[1] * 60, scale=1e-3)
    found = diagnose(CELL, data)
    assert found.heldout is not None
    names = [set(own.poses.names) for own in (found.data, found.heldout)]
    assert (len(names[0]), len(names[1])) == (40, 20)
    assert not names[0] & names[1]
    assert found.gap.heldout_before is not None
    assert found.gap.heldout_after is not None
    assert found.gap.heldout_after < 0.2 * found.gap.heldout_before
    assert found.warnings == (
        "40 of 60 readings were used, spread evenly over all; all of them would show errors 1.2 times "
        "smaller; 20 at other configurations were held out",
    )


def test_readings_of_a_stay_are_no_held_out_poses_beside_others_of_it() -> None:
    own, rest, said = part.part_of(stays(*[3] * 3000))
    assert len(own) == 3000
    assert not len(rest)
    assert said[0].endswith("1.7 times smaller")


@pytest.mark.long
def test_a_diagnosis_of_a_part_is_that_of_the_whole() -> None:
    """The same cause, of the true size by either, and apart by no more than what is left out allows.

    Half of the readings may leave it less sure.
    """
    data = stays(*[20] * 40, scale=2e-4)
    found = [diagnose(CELL, own) for own in (data, thinned(data, 400)[0])]
    assert found[0].verdict == "explained"
    assert found[1].verdict in ("explained", "ambiguous")
    (whole,), (part,) = (one.causes for one in found)
    for cause in (whole, part):
        assert cause.members[0][0].key == "transmission_scale:j2"
        assert abs(cause.values[0] - 2e-4) < 4.0 * cause.std[0]
    assert part.std[0] == pytest.approx(np.sqrt(2.0) * whole.std[0], rel=0.1)
    assert abs(part.values[0] - whole.values[0]) < 3.0 * whole.std[0]


def test_an_identification_of_a_part_is_that_of_the_whole() -> None:
    data = stays(*[30] * 40)
    whole, part = (calib.identify(CELL, own) for own in (data, thinned(data, 400)[0]))
    shown = part.std > 0.0
    off = np.abs(whole.values - part.values)[shown] / part.std[shown]
    assert off.max() < 3.0
    np.testing.assert_allclose(part.std[shown], np.sqrt(3.0) * whole.std[shown], rtol=0.1)
