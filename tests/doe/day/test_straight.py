"""Straight motions of which it is proved that they are free, against MuJoCo and by hand."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calib import Cell
from calib.arm.robot import Shapes
from calib.arrays import Array
from calib.instruments import Tracker
from doe.constraints import constraints_of, scene_of, visible
from doe.constraints.clearance import Clearance, levers_of
from doe.constraints.kept_sight import kept_sights
from doe.constraints.scene import BASE
from doe.day.straight import straight
from tests.doe.constraints.arms import LINK, LINKS, in_mujoco, planar, shaped
from tests.helpers import designed

ARMS = pytest.mark.parametrize("cell", [shaped(20), shaped(23, (1,)), shaped(24, (0, 3))])


def clearances(cell: Cell) -> list[Clearance]:
    return [own for own in constraints_of(cell) if isinstance(own, Clearance)]


def motions(cell: Cell, count: int) -> tuple[Array, Array]:
    """Between configurations at which nothing is met."""
    q = np.random.default_rng(1).uniform(*cell.robot.sample_limits().T, (4000, cell.robot.dof))
    scene = scene_of(cell, q)
    clear = q[np.all([own.allows(scene) for own in clearances(cell)], axis=0)]
    return clear[:count], clear[count : 2 * count]


@ARMS
def test_gaps_say_what_is_allowed(cell: Cell) -> None:
    q = np.random.default_rng(2).uniform(*cell.robot.sample_limits().T, (500, 5))
    scene = scene_of(cell, q)
    for own in clearances(cell):
        assert ((own.gaps(scene) > 0.0).all(axis=1) == own.allows(scene)).all(), own.name


@ARMS
def test_no_point_moves_faster_than_its_levers_allow(cell: Cell) -> None:
    """By differences of positions, at the ends of capsules and at the markers."""
    rng, step = np.random.default_rng(3), 1e-6
    q = rng.uniform(*cell.robot.sample_limits().T, (300, 5))
    rates = rng.uniform(-1.0, 1.0, q.shape)
    before, after = scene_of(cell, q), scene_of(cell, q + step * rates)
    levers = levers_of(cell, np.abs(q).max(axis=0) + step)
    most = np.abs(rates) @ levers.capsules.T
    for k, (a, b) in enumerate(zip(before.capsules, after.capsules, strict=True)):
        for end in ("start", "end"):
            speed = np.linalg.norm(getattr(b, end) - getattr(a, end), axis=1) / step
            assert (speed <= most[:, k] + 1e-6).all()
    speed = np.linalg.norm(after.markers - before.markers, axis=-1) / step
    assert (speed <= np.abs(rates) @ levers.markers.T + 1e-6).all()


@ARMS
def test_what_is_proved_free_meets_nothing_in_mujoco(cell: Cell) -> None:
    """Contacts of geoms at half a degree, or five millimetres, of the joint that goes farthest."""
    start, end = motions(cell, 40)
    cell = replace(cell, markers=np.zeros((0, 3)), marker_names=())
    found = straight(cell, clearances(cell), start, end)
    assert 0.05 < found.free.mean() < 0.95
    model = in_mujoco(cell)
    (own,) = [own for own in clearances(cell) if own.name == "self_collision"]
    capsules = [
        g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CAPSULE
    ]
    wanted = {frozenset((capsules[i], capsules[j])) for i, j in own.pairs}
    still = [g for g in range(model.ngeom) if g not in capsules]
    moving = [
        g for g, c in zip(capsules, scene_of(cell, start).capsules, strict=True) if c.body != BASE
    ]
    wanted |= {frozenset((a, b)) for a in still for b in moving}
    model.geom_contype[:] = model.geom_conaffinity[:] = 1
    model.geom_margin[:] = model.geom_gap[:] = 0.0
    data = mujoco.MjData(model)
    plane = next(o for o in clearances(cell) if o.name.endswith("(halfspace)"))
    for a, b, free, at in zip(start, end, found.free, found.at, strict=True):
        steps = int(np.abs(b - a).max() / np.radians(0.5)) + 2
        shares = np.linspace(0.0, 1.0, steps) if free else [at]
        hit = False
        for q in a + np.asarray(shares)[:, None] * (b - a):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            pairs = {frozenset(pair) for pair in data.contact.geom.tolist()}
            hit |= bool(pairs & wanted) or not plane.allows(scene_of(cell, q[None]))[0]
        # Where it is not proved, it is at most the last hundred-thousandth of the way that misses.
        assert hit is not free or (not free and abs(at - 0.5) > 0.4999)


def test_a_thin_wall_between_two_samples_is_met() -> None:
    """A sheet of a tenth of a millimetre: a look every degree sees it at none of 180."""
    wall = {
        "type": "box",
        "center_mm": (300, 1000 * 0.3 * np.tan(np.radians(0.5)), 0),
        "size_mm": (100, 0.1, 100),
        "rpy_deg": (0, 0, 0.5),
    }
    thin = replace(LINK, radius=1e-4)
    cell = replace(designed(planar(1), obstacle=[wall]), shapes=Shapes({"j1": (thin,)}))
    start, end = np.radians([[-90.0]]), np.radians([[90.0]])
    kept = clearances(cell)
    looks = scene_of(cell, np.radians(np.arange(-90.0, 91.0)[:, None]))
    assert np.all([own.allows(looks) for own in kept])
    found = straight(cell, kept, start, end)
    assert not found.free[0]
    assert kept[found.met[0]].name == "obstacle 1 (box)"
    assert 180.0 * found.at[0] - 90.0 == pytest.approx(0.5, abs=0.1)


def test_the_margin_is_kept() -> None:
    """A link that passes a ball at a distance of 100 mm."""
    ball = {"type": "sphere", "center_mm": (0, 1300, 0), "radius_mm": 100.0}
    for margin, free in ((99.0, True), (101.0, False)):
        cell = designed(planar(1), obstacle=[ball], margin_mm=margin)
        cell = replace(cell, shapes=Shapes({"j1": (LINK,)}))
        found = straight(cell, clearances(cell), np.array([[0.0]]), np.array([[np.pi]]))
        assert found.free[0] == free


def test_an_arm_without_shapes_meets_nothing() -> None:
    found = straight(planar(), (), np.zeros((2, 3)), np.ones((2, 3)))
    assert found.free.all()
    assert found.looked == 0


@pytest.mark.parametrize("normal", [False, True])
def test_sight_that_is_proved_kept_is_seen_at_every_step(normal: bool) -> None:
    """A planar arm with a normal marker and an instrument, a ball and its own links between them."""
    ball = {"type": "sphere", "center_mm": (2500, 900, 0), "radius_mm": 150.0}
    cell = designed(planar(3), obstacle=[ball])
    normals, acceptance = np.full((1, 3), np.nan), np.array([np.nan])
    if normal:
        normals, acceptance = np.array([[1.0, 0.2, 0.0]]) / np.hypot(1.0, 0.2), np.radians([70.0])
    tracker = Tracker(stands=np.array([4.0, 1.0, 0.3]), keeps_sight=True, name="tracker")
    cell = replace(
        cell,
        markers=np.array([[0.15, 0.0, 0.137]]),
        shapes=Shapes(LINKS),
        instruments=(tracker,),
        marker_normals=normals,
        marker_acceptance=acceptance,
    )
    (sight,) = kept_sights(cell)
    q = np.random.default_rng(4).uniform(-np.pi, np.pi, (2000, 3))
    q = q[visible(scene_of(cell, q))[:, 0]]
    start, end = q[:150], q[150:300]
    found = straight(cell, (sight,), start, end)
    assert 0.02 < found.free.mean() < 0.95
    for a, b, free, at in zip(start, end, found.free, found.at, strict=True):
        shares = np.linspace(0.0, 1.0, 1500)[:, None] if free else np.array([[at]])
        seen = visible(scene_of(cell, a + shares * (b - a)))[:, 0]
        assert seen.all() if free else not seen[0]
