"""The arm against itself and its base, against MuJoCo and by hand."""

from __future__ import annotations

import mujoco
import numpy as np

from calib import Cell
from calib.arm.robot import Capsule, Shapes
from doe.constraints import constraints_of
from doe.constraints.scene import Scene
from doe.constraints.self_collision import SelfCollision
from tests.doe.constraints.arms import (
    LINKS,
    allowed,
    capsule_geoms,
    configurations,
    only,
    planar,
)


def test_collisions_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    geoms, capsules = capsule_geoms(scene, model), scene.capsules
    constraints = {c.name: c for c in constraints_of(cell)}
    crossing = constraints["self_collision"]
    assert isinstance(crossing, SelfCollision)
    bodies = [c.body for c in capsules]
    count = len(bodies)
    could = {(i, j) for i in range(count) for j in range(count) if bodies[j] - bodies[i] > 1}
    names = {(capsules[i].name, capsules[j].name): (i, j) for i, j in could}
    exempt = {names[pair] for pair in crossing.exempt}
    assert set(crossing.pairs) | exempt == could
    obstacles = {
        "obstacle 1 (box)": model.geom("box").id,
        "obstacle 2 (sphere)": model.geom("ball").id,
    }
    gaps: dict[str, list[float]] = {name: [] for name in (*obstacles, "self_collision")}
    for data in configurations(scene, model):

        def gap(a: int, b: int, data: mujoco.MjData = data) -> float:
            return mujoco.mj_geomDistance(model, data, a, b, 10.0, None)

        for name, geom in obstacles.items():
            gaps[name].append(min(gap(g, geom) for g, b in zip(geoms, bodies, strict=True) if b))
        pairs = crossing.pairs
        gaps["self_collision"].append(min(gap(geoms[i], geoms[j]) for i, j in pairs))
    for name, found in gaps.items():
        clear = np.abs(found) > 1e-5  # MuJoCo's own accuracy where a box is concerned
        allowed = constraints[name].allows(scene)
        np.testing.assert_array_equal(allowed[clear], np.array(found)[clear] > 0.0, err_msg=name)
        assert 0 < allowed.sum() < len(allowed)


def test_self_collision_spares_neighbours() -> None:
    cell = planar(shapes=Shapes(LINKS))
    crossing = only(cell)
    assert isinstance(crossing, SelfCollision)
    assert [crossing.pairs, crossing.exempt] == [((0, 2),), ()]
    # Links 1 and 2 on top of each other are neighbours; folded twice, links 1 and 3 meet.
    q = ((0, 0, 0), (0, 180, 0), (0, 170, 170), (0, 90, 150), (0, 90, 135), (0, 90, 90))
    assert allowed(cell, *q) == [True, False, False, False, True, True]


def test_pairs_that_always_overlap_are_exempt() -> None:
    """As at a spherical wrist: balls around one centre, with an arm each."""
    ball = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2)
    arm = Capsule((0.5, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    crossing = only(
        planar(
            origins=np.tile(np.eye(4), (4, 1, 1)),
            shapes=Shapes({"j1": (arm, ball), "j3": (ball, arm)}),
        )
    )
    assert isinstance(crossing, SelfCollision)
    assert crossing.exempt == (("j1 #2", "j3 #1"),)
    assert crossing.pairs == ((0, 2), (0, 3), (1, 3))
