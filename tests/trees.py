"""Robots whose links are trees: random ones as URDF, and their kinematics link by link."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.urdf import load_urdf
from tests.plain_arm import frame, shift, turn

KINDS = ("revolute", "continuous", "prismatic", "fixed")
FLAGS = (
    '<mujoco><compiler fusestatic="false" discardvisual="false" boundmass="1e-9" '
    'boundinertia="1e-9"/></mujoco>'
)


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

    @classmethod
    def drawn(
        cls, rng: np.random.Generator, name: str, kind: str, parent: str, child: str
    ) -> Joint:
        """About a random axis, anywhere near its parent."""
        axis, (xyz, rpy) = rng.normal(size=3), rng.uniform(-0.5, 0.5, (2, 3))
        mass, com = rng.uniform(1.0, 5.0), rng.normal(size=3) * 0.1
        return cls(name, kind, parent, child, xyz, rpy, axis / np.linalg.norm(axis), mass, com)

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


def chain(rng: np.random.Generator, kinds: Mapping[str, str]) -> list[Joint]:
    """Joints by name, each on the one before: link root carries l_<first>, and so on."""
    joints: list[Joint] = []
    for name, kind in kinds.items():
        parent = joints[-1].child if joints else "root"
        joints.append(Joint.drawn(rng, name, kind, parent, f"l_{name}"))
    return joints


def random_tree(seed: int) -> tuple[list[Joint], str, list[str]]:
    """Joints, parents first, the tip of a chain from link c0, and further links below c0."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 7))
    joints = [Joint.drawn(rng, "k0", "revolute", "root", "c0")]
    for i in range(count):
        kind = KINDS[int(rng.integers(4)) if i else 0]
        joints.append(Joint.drawn(rng, f"k{i + 1}", kind, f"c{i}", f"c{i + 1}"))
    links, tip = ["root", *(joint.child for joint in joints)], f"c{count}"
    for number in range(12):
        parent, kind = links[int(rng.integers(len(links)))], KINDS[int(rng.integers(4))]
        joints.append(Joint.drawn(rng, f"s{number}", kind, parent, f"b{number}"))
        links.append(f"b{number}")
    below = ["c0"]
    for joint in joints:
        if joint.parent in below:
            below.append(joint.child)
    others = rng.permutation([link for link in below if link != tip])
    return joints, tip, others[: int(rng.integers(1, 4))].tolist()


def placed(joints: list[Joint], values: Mapping[str, float]) -> dict[str, Array]:
    """Every link's frame in that of the root."""
    found = {"root": np.eye(4)}
    for joint in joints:
        found[joint.child] = found[joint.parent] @ joint.moved(values.get(joint.name, 0.0))
    return found


def read(folder: Path, joints: list[Joint], tip: str, others: Sequence[str] = ()) -> Robot:
    """The robot from c0 to tips, of a file that is written anew."""
    (folder / "tree.urdf").write_text(urdf(joints))
    return load_urdf(folder / "tree.urdf", "c0", tip, others)


def urdf(joints: list[Joint]) -> str:
    return f'<robot name="tree"><link name="root"/>{"".join(j.text for j in joints)}</robot>'


def flagged(text: str) -> str:
    """A URDF of which MuJoCo keeps every fixed link."""
    return re.sub(r"(<robot[^>]*>)", r"\1" + FLAGS, text, count=1)


def in_mujoco(text: str) -> mujoco.MjModel:
    """The model of a URDF as MuJoCo reads it."""
    return mujoco.MjModel.from_xml_string(flagged(text))


def as_mjcf(text: str) -> str:
    """A URDF as MuJoCo saves it."""
    spec = mujoco.MjSpec.from_string(flagged(text))
    spec.compile()
    return str(spec.to_xml())


def random_mjcf(rng: np.random.Generator, dof: int, tip: str = "site") -> str:
    """A chain from body ``base`` to ``tip`` with joints j1 .. jn, a branch at every link.

    The tip is a site, a body without joints, or the last link. Several joints a body or none, off its
    origin and with a reference; masses from inertials and from shapes, and of bodies fixed to links.
    """

    def words(values: Array) -> str:
        return " ".join(repr(float(v)) for v in values)

    def pose() -> str:
        return f'pos="{words(rng.uniform(-0.5, 0.5, 3))}" quat="{words(rng.normal(size=4))}"'

    ball = '<geom size="0.05"/>'
    lines = [
        '<mujoco model="random"><compiler angle="radian" autolimits="true"/>'
        '<option gravity="0 0 -9.80665"/><worldbody>'
        f'<geom type="plane" size="1 1 1"/><body name="base" {pose()}>{ball}'
    ]
    joint, depth = 0, 1
    while joint < dof:
        here = min(int(rng.integers(0, 4)), dof - joint)
        name = 'name="tip"' if tip == "link" and joint + here == dof else ""
        mass = f'<inertial pos="{words(rng.normal(size=3) * 0.1)}" mass="3" diaginertia="1 1 1"/>'
        lines.append(f"<body {name} {pose()}>{mass if rng.integers(2) else ball}")
        depth += 1
        for _ in range(here):
            joint += 1
            more = ['range="-2 3"', 'actuatorfrcrange="-50 60"', f'ref="{rng.normal()!r}"']
            kept = " ".join(own for own in more if rng.integers(2))
            lines.append(
                f'<joint name="j{joint}" type="{"hinge" if rng.integers(4) else "slide"}" '
                f'axis="{words(rng.normal(size=3))}" pos="{words(rng.normal(size=3) * 0.3)}" {kept}/>'
            )
        lines.append(f"<body {pose()}><joint/>{ball}<body {pose()}>{ball}</body></body>")
        lines.append(f"<body {pose()}>{ball}</body>")
    if tip != "link":
        lines.append(f'<{tip} name="tip" {pose()}/>')
    return "\n".join([*lines, "</body>" * depth, "</worldbody></mujoco>", ""])
