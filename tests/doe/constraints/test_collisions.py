"""Distances of shapes; arms against themselves and what is around them, by hand and by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.robot import Capsule, Shapes
from calib.arrays import Array
from calib.errors import CalibError
from doe.constraints import constraints_of, scene_of
from doe.constraints.distances import (
    point_segment,
    segment_box,
    segment_halfspace,
    segment_segment,
)
from doe.constraints.scene import Scene
from doe.constraints.self_collision import SelfCollision, clear_of_itself
from tests.doe.constraints.arms import (
    capsule_geoms,
    configurations,
    planar,
    shaped,
)
from tests.two_arms import urdf, written

POINT, NORMAL, HALF = (
    np.array([0.1, 0.2, 0.3]),
    np.array([1.0, -2.0, 0.5]),
    np.array([0.3, 0.7, 0.5]),
)


def segments(seed: int, count: int = 500) -> tuple[Array, Array]:
    """Segments of all lengths around the origin."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2.0, 2.0, (count, 3))
    return start, start + rng.normal(size=(count, 3)) * rng.uniform(0.01, 2.0, (count, 1))


A, B = segments(1)
C, D = segments(2)


DISTANCES: dict[str, tuple[Callable[..., Array], Callable[[Array], Array]]] = {
    "point": (
        lambda a, b: point_segment(POINT, a, b),
        lambda x: np.linalg.norm(x - POINT, axis=-1),
    ),
    "segment": (lambda a, b: segment_segment(a, b, C, D), lambda x: point_segment(x, C, D)),
    "box": (
        lambda a, b: segment_box(a, b, HALF),
        lambda x: np.linalg.norm(x - np.clip(x, -HALF, HALF), axis=-1),
    ),
    "half-space": (
        lambda a, b: segment_halfspace(a, b, POINT, NORMAL),
        lambda x: np.maximum((POINT - x) @ NORMAL / np.linalg.norm(NORMAL), 0.0),
    ),
}


@pytest.mark.parametrize("shape", DISTANCES)
def test_distances_are_the_least_along_a_segment(shape: str) -> None:
    """Each is convex along the segment: thirds of the interval are cut off until nothing is left."""
    of_segment, away = DISTANCES[shape]
    found, low, high = of_segment(A, B), np.zeros(len(A)), np.ones(len(A))
    for _ in range(150):
        third = (high - low) / 3.0
        one, two = (away(A + t[:, None] * (B - A)) for t in (low + third, high - third))
        low, high = np.where(one > two, low + third, low), np.where(one > two, high, high - third)
    np.testing.assert_allclose(found, away(A + low[:, None] * (B - A)), atol=1e-8)
    assert (found > 0.01).sum() > 20


def test_degenerate_segments() -> None:
    """Points, parallel, collinear and crossing segments, in either order."""
    o, x, y, z = np.zeros(3), *np.eye(3)
    cases = [
        (o, o, x, x, 1.0),  # two points
        (o, x, 0.5 * x + y, 0.5 * x + y, 1.0),  # a point beside a segment
        (o, 2 * x, x + y, 4 * x + y, 1.0),  # parallel, side by side in part
        (o, x, 4 * x + 4 * y, 8 * x + 4 * y, 5.0),  # parallel, one after the other
        (o, x, 8 * x + 4 * y, 4 * x + 4 * y, 5.0),  # the same, opposite directions
        (o, x, 3 * x, 5 * x, 2.0),  # in line
        (o, 2 * x, x, 5 * x, 0.0),  # in line, overlapping
        (-x, x, -y + 0.25 * z, y + 0.25 * z, 0.25),  # crossing
        (o, x, o, x, 0.0),
    ]
    a, b, c, d, expected = (np.array(column) for column in zip(*cases, strict=True))
    for ends in ((a, b, c, d), (c, d, a, b), (b, a, c, d)):
        np.testing.assert_allclose(segment_segment(*ends), expected, atol=1e-12)
    box = ((3 * x, 3 * x, 2.5), (x - 9 * y, x + 9 * y, 0.5), (-9 * y, 9 * y, 0.0))
    for start, end, away in box:
        np.testing.assert_allclose(segment_box(start, end, np.full(3, 0.5)), away, atol=1e-15)


@pytest.mark.parametrize("angle", 10.0 ** -np.arange(1.0, 17.0))
def test_nearly_parallel_segments(angle: float) -> None:
    """At every angle, however small, the distance is right to the square root of rounding."""
    a, b, c = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, angle, 1e-3]])
    assert segment_segment(a, b, c * [-1, -1, 1], c) == pytest.approx(1e-3, abs=1e-9)


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


def test_neighbours_and_pairs_that_always_overlap_are_exempt() -> None:
    """As at a spherical wrist: balls around one centre, with an arm each."""
    ball = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2)
    arm = Capsule((0.5, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    wrist = {"j1": (arm, ball), "j3": (ball, arm)}
    (found,) = constraints_of(planar(shapes=Shapes({"j1": (arm,), "j2": (arm,), "j3": (arm,)})))
    assert isinstance(found, SelfCollision)
    assert (found.pairs, found.exempt) == (((0, 2),), ())
    (found,) = constraints_of(planar(origins=np.tile(np.eye(4), (4, 1, 1)), shapes=Shapes(wrist)))
    assert isinstance(found, SelfCollision)
    assert found.exempt == (("j1 #2", "j3 #1"),)
    assert found.pairs == ((0, 2), (0, 3), (1, 3))


def test_names_of_capsules() -> None:
    names = [c.name for c in scene_of(shaped(1), np.zeros((2, 5))).capsules]
    assert names == ["base", "j1", "j3 #1", "j3 #2", "j4", "j5", "tool #1", "tool #2"]


def test_scene_of_another_robot() -> None:
    with pytest.raises(CalibError, match=r"shape \(2, 4\), expected \(n, 3\)"):
        scene_of(planar(), np.zeros((2, 4)))


BALLS = {
    # At the zero pose both hands meet in front of the body, and elbows the torso.
    "right_hand": ("0 0.17 0", 0.06),
    "left_hand": ("0 -0.17 0", 0.06),
    "right3_link": ("0 0 -0.1", 0.07),
    "left3_link": ("0 0 -0.1", 0.07),
    "right1_link": ("0.05 0 -0.05", 0.06),
    "right2_link": ("0 0 -0.24", 0.03),
    "head": ("0.05 0 0.1", 0.1),
    "torso": ("0 0 0.1", 0.15),
    "chest": ("0 0 0.15", 0.12),
}
OF_CAPSULES = {
    "hip": "torso", "bend #1": "chest", "bend #2": "head", "right6": "right_hand", "left6": "left_hand",
}  # fmt: skip
"""What capsules are called after the joint that moves them, where that is not the link's own name."""
NEIGHBOURS = {
    frozenset(pair)
    for pair in (
        ("chest", "head"), ("torso", "chest"), ("torso", "head"), ("chest", "right1_link"),
        ("head", "right1_link"), ("right1_link", "right2_link"), ("right2_link", "right3_link"),
    )
}  # fmt: skip
"""One carries the other, with no joint or one between them: neck and head do not move here."""
TIPS = '[markers_mm]\nright = [0, 0, -50]\nleft = { position = [0, 0, -50], on = "left_hand" }\n'


def pair_urdf() -> str:
    """The two-armed robot with a ball on some of its links."""
    text = urdf()
    for link, (at, radius) in BALLS.items():
        head = f'<link name="{link}">'
        assert head in text
        ball = f'<geometry><sphere radius="{radius}"/></geometry>'
        text = text.replace(head, f'{head}<collision><origin xyz="{at}"/>{ball}</collision>')
    return text


def test_hands_that_meet_at_zero_are_kept_apart(tmp_path: Path) -> None:
    path = written(tmp_path, TIPS, "[instrument]\nsigma_mm = 0.02\n")
    (tmp_path / "pair.urdf").write_text(pair_urdf())
    cell = calib.load_cell(path)
    constraint = clear_of_itself(cell)
    assert constraint is not None
    joints = cell.robot.joints
    # What a capsule is called, and the links of the robot's file.
    link = {joint: f"{joint}_link" for joint in joints} | OF_CAPSULES
    # At zero, and with the first joint of one arm, that of the other, or the torso moved.
    q = np.zeros((4, len(joints)))
    for row, joint in enumerate(("right1", "left1", "hip"), 1):
        q[row, joints.index(joint)] = 0.6
    scene = scene_of(cell, q)
    names = [link[c.name] for c in scene.capsules]
    checked = {frozenset((names[i], names[j])) for i, j in constraint.pairs}
    exempt = {frozenset((link[a], link[b])) for a, b in constraint.exempt}
    assert sorted(names) == sorted(BALLS)
    assert frozenset(("right_hand", "left_hand")) in checked
    assert exempt == {frozenset(("torso", f"{side}3_link")) for side in ("right", "left")}
    assert checked | exempt == {frozenset(pair) for pair in combinations(BALLS, 2)} - NEIGHBOURS
    assert constraint.allows(scene).tolist() == [False, True, True, False]
