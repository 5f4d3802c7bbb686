"""URDFs that are trees: the chain is read, all beside it and beyond the tip is held at zero.

The oracle is plain: every link of the tree placed by its own product of matrices, weights summed by
hand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import forward, link_origins
from calib.arm.statics import Payload, loads_of, transmitted
from calib.files.shapes import urdf_shapes
from calib.poses import poses_at
from tests.helpers import GRAVITY
from tests.trees import Joint, placed, random_tree, read


def beyond(joints: list[Joint], name: str) -> list[Joint]:
    """Joints whose links a joint moves, its own first."""
    found = [next(j for j in joints if j.name == name)]
    for joint in found:  # grows
        found += [other for other in joints if other.parent == joint.child]
    return found


@pytest.mark.parametrize("seed", range(8))
def test_places_and_torques_are_those_of_the_whole_tree(tmp_path: Path, seed: int) -> None:
    joints, chain = random_tree(seed)
    tip = f"c{len(chain)}"
    robot = read(tmp_path, joints, tip)
    kinds = {j.name: j.kind for j in joints}
    assert robot.joints == tuple(name for name in chain if kinds[name] != "fixed")
    q = np.random.default_rng(seed).uniform(-1, 1, (3, robot.dof))
    frames = forward(robot, q)
    loads = loads_of(robot, poses_at(q), Payload(), GRAVITY)
    local = transmitted(robot, loads, frames, link_origins(robot, frames, q)).local[:, 1:-1]
    felt = np.where(robot.prismatic[:, None], local[..., :3], local[..., 3:])
    ours = (felt * robot.axes).sum(axis=-1)
    for i, row in enumerate(q):
        T = placed(joints, dict(zip(robot.joints, row, strict=True)))
        at_base = np.linalg.inv(T["c0"])
        np.testing.assert_allclose(frames.o[i, -1], (at_base @ T[tip])[:3, 3], atol=1e-12)
        np.testing.assert_allclose(frames.R[i, -1], (at_base @ T[tip])[:3, :3], atol=1e-12)
        for k, name in enumerate(robot.joints):
            moved = beyond(joints, name)
            own = at_base @ T[moved[0].child]
            axis, total = own[:3, :3] @ moved[0].axis, 0.0
            for joint in moved:
                com = (at_base @ T[joint.child] @ [*joint.com, 1.0])[:3]
                weight = joint.mass * GRAVITY
                slides = moved[0].kind == "prismatic"
                total += axis @ (weight if slides else np.cross(com - own[:3, 3], weight))
            assert ours[i, k] == pytest.approx(total, abs=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_shapes_beside_the_chain_go_with_the_link_that_carries_them(
    tmp_path: Path, seed: int
) -> None:
    joints, chain = random_tree(seed)
    tip = f"c{len(chain)}"
    robot = read(tmp_path, joints, tip)
    shapes = urdf_shapes(tmp_path / "tree.urdf", "c0", tip)
    T = placed(joints, {})
    owner: dict[str, str] = {"c0": "base"}
    for joint in joints:
        if joint.parent in owner:
            own = joint.name if joint.name in robot.joints else owner[joint.parent]
            owner[joint.child] = own
    carrier = {"base": "c0"} | {j.name: j.child for j in joints}
    for name, capsules in shapes.capsules.items():
        links = [j for j in joints if owner.get(j.child) == name]
        frame = np.linalg.inv(T[carrier[name]])
        expected = sorted(tuple((frame @ T[j.child] @ [*j.com, 1.0])[:3]) for j in links)
        np.testing.assert_allclose(sorted(c.start for c in capsules), expected, atol=1e-9)
