"""Two arms in shapes of their own, against MuJoCo: what meets, and what is not asked."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np

import calib
from calib.arrays import Array
from doe.constraints import scene_of
from doe.constraints.self_collision import clear_of_itself
from tests.trees import in_mujoco
from tests.two_arms import urdf, written

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
LINKS = {
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


def shaped() -> str:
    """The two-armed robot with a ball on some of its links."""
    text = urdf()
    for link, (at, radius) in BALLS.items():
        head = f'<link name="{link}">'
        assert head in text
        ball = f'<geometry><sphere radius="{radius}"/></geometry>'
        text = text.replace(head, f'{head}<collision><origin xyz="{at}"/>{ball}</collision>')
    return text


def gaps(q: Array, joints: tuple[str, ...]) -> dict[frozenset[str], Array]:
    """Distances (m,) of the balls of each pair of links, m, by MuJoCo."""
    model = in_mujoco(shaped())
    data = mujoco.MjData(model)
    at = [int(model.joint(name).qposadr[0]) for name in joints]
    geom = {link: int(model.body(link).geomadr[0]) for link in BALLS}
    found: dict[frozenset[str], list[float]] = {frozenset(p): [] for p in combinations(BALLS, 2)}
    for row in q:
        data.qpos[at] = row
        mujoco.mj_kinematics(model, data)
        for pair, own in found.items():
            a, b = (geom[link] for link in pair)
            own.append(mujoco.mj_geomDistance(model, data, a, b, 10.0, None))
    return {pair: np.array(own) for pair, own in found.items()}


def test_hands_that_meet_at_zero_are_kept_apart_and_all_else_is_as_in_mujoco(
    tmp_path: Path,
) -> None:
    path = written(tmp_path, TIPS, "[instrument]\nsigma_mm = 0.02\n")
    (tmp_path / "pair.urdf").write_text(shaped())
    cell = calib.load_cell(path)
    constraint = clear_of_itself(cell)
    assert constraint is not None
    joints = cell.robot.joints
    # What a capsule is called, and the links of the robot's file.
    link = {joint: f"{joint}_link" for joint in joints} | LINKS
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (1500, len(joints)))
    q[0] = 0.0
    apart = gaps(q, joints)
    scene = scene_of(cell, q)
    names = [link[c.name] for c in scene.capsules]
    checked = {frozenset((names[i], names[j])) for i, j in constraint.pairs}
    exempt = {frozenset((link[a], link[b])) for a, b in constraint.exempt}
    assert sorted(names) == sorted(BALLS)
    assert frozenset(("right_hand", "left_hand")) in checked
    assert exempt == {frozenset(("torso", f"{side}3_link")) for side in ("right", "left")}
    assert all(apart[pair][0] < 0.0 for pair in exempt)
    assert checked | exempt == set(apart) - NEIGHBOURS
    least = np.min([apart[pair] for pair in checked], axis=0)
    clear = np.abs(least) > 1e-8
    free = constraint.allows(scene)
    np.testing.assert_array_equal(free[clear], least[clear] > 0.0)
    assert not free[0]
    assert 0.2 < free.mean() < 0.9
