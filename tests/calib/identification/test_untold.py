"""What the data cannot tell stays where it was, and nothing runs away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Identification, Measurements
from calib.arrays import Array
from calib.identification import fit
from tests.calib.identification.test_identify import MARKERS, measured, random_configurations
from tests.calib.instruments.test_pose import cell_with, noisy, rows
from tests.calib.instruments.test_pose import measured as of_bodies
from tests.helpers import cell_of, with_effects
from tests.plain_arm import frame, tips

PLACES = ("base", "tool", "geometry")
BODY = np.array([0.05, -0.03, 0.2, 0.3, -0.2, 0.4])
STAND = np.array([1.5, -0.4, 0.3, 0.2, 0.5, -1.1])


def level(cell: Cell, rng: np.random.Generator, count: int, turn: float) -> Array:
    """Joints at which the flange turns by ``turn`` rad at most: what A2 and A3 do, A5 undoes."""
    q = np.tile(np.radians([10.0, -60.0, 70.0, 0.0, 35.0, 20.0]), (count, 1))
    moved = rng.uniform(-0.3, 0.3, (count, 2))
    q[:, 1:3] += moved
    q[:, 4] -= moved.sum(axis=1)
    return q + turn * rng.uniform(-0.5, 0.5, q.shape)


def largest(found: Identification, *effects: str) -> float:
    """Of the values of these effects, m and rad."""
    own = [p.effect in effects for p in found.model.parameters]
    return float(np.abs(found.values[own]).max())


@pytest.mark.parametrize("turn", [0.0, 1e-3, 0.03])
def test_a_body_on_a_flange_that_hardly_turns(kr270: Cell, turn: float) -> None:
    rng = np.random.default_rng(0)
    cell = cell_with(kr270.robot, effects=PLACES)
    q = level(cell, rng, 40, turn)
    error = np.array([0.0, 1e-3, -1e-3, 0.0, 2e-3, 0.0])
    seen = frame(STAND) @ tips(kr270.robot, q + error) @ frame(BODY)
    noise = rng.normal(size=(40, 6)) * np.repeat([2e-4, 5e-4], 3)
    found = calib.identify(cell, of_bodies(q, rows(noisy(seen, noise))))
    assert largest(found, "tool", "base") < 10.0
    assert found.rms("nominal") < 0.02
    assert found.rms("fitted") < 5e-4
    if turn < 1e-2:
        assert found.status == "rank_deficient"


def test_a_marker_that_a_still_flange_does_not_tell_keeps_its_guess(kr270: Cell) -> None:
    rng = np.random.default_rng(1)
    cell = with_effects(cell_of(kr270.robot, MARKERS[:1], PLACES), "base", "tool")
    poses = replace(random_configurations(cell, rng, 30), q=level(cell, rng, 30, 0.0))
    data, _ = measured(cell, poses, rng, size=0.0)
    found = calib.identify(cell, data)
    assert found.unidentifiable
    assert largest(found, "tool") < 1e-6
    assert found.rms("fitted") < 1e-4


def test_stations_with_a_body_each_stay_in_the_room(kr270: Cell) -> None:
    """Neither station sees the other's bodies, and each few poses."""
    rng = np.random.default_rng(2)
    cell = cell_with(kr270.robot, effects=PLACES, bodies=4)
    q = level(cell, rng, 24, 1e-3)
    station = np.repeat([0, 1], 12)
    tip = tips(kr270.robot, q + 1e-3 * rng.normal(size=6))
    stands = [frame(STAND), frame(-STAND)]
    at = np.array([stands[s] for s in station])
    bodies = np.stack([at @ tip @ frame(BODY + 0.1 * k) for k in range(4)], axis=1)
    readings = np.concatenate([rows(bodies[:, k]) for k in range(4)], axis=1)
    seen = (np.arange(4)[None, :] // 2) == station[:, None]
    data = of_bodies(q, readings)
    poses = replace(data.poses, station=station, stations=("north", "south"))
    found = calib.identify(cell, replace(data, poses=poses, seen=seen))
    assert largest(found, "tool", "base") < 10.0


@pytest.mark.parametrize("q", ["one joint", "same"])
def test_poses_that_tell_next_to_nothing(kr270: Cell, q: str) -> None:
    rng = np.random.default_rng(3)
    cell = with_effects(cell_of(kr270.robot, MARKERS, PLACES), *PLACES)
    poses = random_configurations(cell, rng, 30)
    still = np.tile(poses.q[:1], (30, 1))
    still[:, 3] = poses.q[:, 3] if q == "one joint" else still[:, 3]
    data, _ = measured(cell, replace(poses, q=still), rng)
    found = calib.identify(cell, data)
    assert found.status == "rank_deficient"
    assert largest(found, "tool", "base") < 30.0


def test_what_runs_away_is_told_and_stays(kr270: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that loses the first marker begins anew without it."""
    rng = np.random.default_rng(4)
    cell = with_effects(cell_of(kr270.robot, MARKERS, PLACES), "base", "tool")
    data, _ = measured(cell, random_configurations(cell, rng, 30), rng)
    asked: list[int] = []

    def lost(model: calib.Model, data: Measurements, start: Array, values: Array) -> Array:
        asked.append(1)
        out = np.zeros(len(values), dtype=bool)
        out[model.parameters.index(next(p for p in model.parameters if p.effect == "tool"))] = (
            len(asked) == 1
        )
        return out

    monkeypatch.setattr(fit, "diverged", lost)
    found = calib.identify(cell, data)
    (lost_one,) = found.unidentifiable
    assert lost_one.names == ("tool:marker:m1.x",)
    assert "ran away" in lost_one.reason
