"""URDFs that are trees: the chain is read, all beside it and beyond the tip is held at zero.

The oracle is plain: every link of the tree placed by its own product of matrices, weights summed by
hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.files.shapes import urdf_shapes
from calib.files.urdf import load_urdf
from calib.poses import poses_at
from tests.helpers import GRAVITY
from tests.plain_arm import frame, shift, turn

KINDS = ("revolute", "continuous", "prismatic", "fixed")


@dataclass(frozen=True)
class Joint:
    """A joint and the link that it moves; mass and com of the link."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Array
    rpy: Array
    axis: Array
    mass: float
    com: Array

    @property
    def text(self) -> str:
        words = {
            k: " ".join(map(repr, getattr(self, k).tolist())) for k in ("xyz", "rpy", "axis", "com")
        }
        return (
            f'<joint name="{self.name}" type="{self.kind}"><parent link="{self.parent}"/>'
            f'<child link="{self.child}"/><origin xyz="{words["xyz"]}" rpy="{words["rpy"]}"/>'
            f'<axis xyz="{words["axis"]}"/>'
            '<limit lower="-2" upper="2" effort="0" velocity="1"/></joint>'
            f'<link name="{self.child}"><inertial><origin xyz="{words["com"]}"/>'
            f'<mass value="{self.mass!r}"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
            f'<collision><origin xyz="{words["com"]}"/>'
            '<geometry><sphere radius="0.01"/></geometry></collision>'
            "</link>"
        )  # fmt: skip

    def moved(self, q: float) -> Array:
        """From the parent's frame to the child's, shape (4, 4)."""
        r, p, y = self.rpy
        T = shift(*self.xyz) @ turn("z", y) @ turn("y", p) @ turn("x", r)
        slides, turns = self.kind == "prismatic", self.kind in ("revolute", "continuous")
        return T @ frame(q * np.concatenate([self.axis * slides, self.axis * turns]))


def random_tree(seed: int) -> tuple[list[Joint], list[str]]:
    """Joints, parents first, and the names of those that lead from link c0 to the tip."""
    rng = np.random.default_rng(seed)
    joints: list[Joint] = []

    def add(name: str, kind: str, parent: str, child: str) -> None:
        axis = rng.normal(size=3)
        numbers = rng.uniform(-0.5, 0.5, (2, 3)), rng.uniform(1.0, 5.0), rng.normal(size=3) * 0.1
        (xyz, rpy), mass, com = numbers
        joints.append(
            Joint(name, kind, parent, child, xyz, rpy, axis / np.linalg.norm(axis), mass, com)
        )

    count = int(rng.integers(3, 7))
    chain = [f"k{i + 1}" for i in range(count)]
    add("k0", "revolute", "root", "c0")
    for i, name in enumerate(chain):
        add(name, KINDS[int(rng.integers(4)) if i else 0], f"c{i}", f"c{i + 1}")
    links = ["root", *(f"c{i}" for i in range(count + 1))]
    for number in range(12):
        parent = links[int(rng.integers(len(links)))]
        add(f"s{number}", KINDS[int(rng.integers(4))], parent, f"b{number}")
        links.append(f"b{number}")
    return joints, chain


def placed(joints: list[Joint], values: dict[str, float]) -> dict[str, Array]:
    """Every link's frame in that of the root."""
    found = {"root": np.eye(4)}
    for joint in joints:
        found[joint.child] = found[joint.parent] @ joint.moved(values.get(joint.name, 0.0))
    return found


def read(folder: Path, joints: list[Joint], tip: str) -> Robot:
    text = f'<robot name="tree"><link name="root"/>{"".join(j.text for j in joints)}</robot>'
    (folder / "tree.urdf").write_text(text)
    return load_urdf(folder / "tree.urdf", "c0", tip)


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
    local = transmitted(loads, frames, link_origins(robot, frames, q)).local[:, 1:-1]
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
