"""Arms of four joints in plain numpy, and the files of those who measured them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arrays import Array
from tests.plain_arm import shift, turn

SIGMA = 10e-6  # m
MARKERS = np.array([[0.15, 0.02, 0.0], [0.0, 0.12, 0.08], [-0.05, 0.0, 0.16]])
_LINKS = (0.3, 0.4, 0.35, 0.1)  # m, from each joint to the next
_AXES = "zyyx"
URDF = """\
<robot name="{type}"><link name="base"/>{links}
{joints}
</robot>
"""
_JOINT = """\
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>
<limit lower="-2" upper="2" effort="0" velocity="1"/></joint>"""
CELL = """\
schema = 1
name = "{name}"
[robot]
urdf = "robot.urdf"
base = "base"
tip = "l4"
[markers_mm]
m1 = [150, 20, 0]
m2 = [0, 120, 80]
m3 = [-50, 0, 160]
[instrument]
sigma_mm = 0.01
[model]
effects = ["base", "tool", "joint_offset:j2,j3"]
"""


def urdf(kind: str) -> str:
    """The arm as its maker describes it: z, y, y, x."""
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    names = ["base", "l1", "l2", "l3", "l4"]
    joints = [
        _JOINT.format(k=k + 1, parent=names[k], child=names[k + 1], z=_LINKS[k], axis=axes[axis])
        for k, axis in enumerate(_AXES)
    ]
    links = "".join(f'<link name="{name}"/>' for name in names[1:])
    return URDF.format(type=kind, links=links, joints="\n".join(joints))


def points(q: Array) -> Array:
    """Markers in the base, shape (m, 3, 3), m; q : ndarray, shape (m, 4), rad."""
    found = []
    for own in q:
        T = np.eye(4)
        for link, axis, angle in zip(_LINKS, _AXES, own, strict=True):
            T = T @ shift(z=link) @ turn(axis, float(angle))
        found.append(MARKERS @ T[:3, :3].T + T[:3, 3])
    return np.array(found)


def table(offsets: tuple[float, float], seed: int, count: int = 10, ripple: float = 0.0) -> str:
    """What a tracker reads of an arm whose second and third joint are off, rad.

    ripple : rad, by which the third joint errs as the sine of its angle
    """
    rng = np.random.default_rng(seed)
    q = np.radians(np.round(np.degrees(rng.uniform(-1.8, 1.8, (count, 4))), 4))
    stands = q + np.array([0.0, *offsets, 0.0])
    stands[:, 2] += ripple * np.sin(q[:, 2])
    placed = turn("z", 0.7) @ turn("x", 0.3)
    read = points(stands) @ placed[:3, :3].T + [1.0, -2.0, 0.5]
    read += rng.normal(size=read.shape) * SIGMA
    lines = ["pose,marker,j1_deg,j2_deg,j3_deg,j4_deg,x_mm,y_mm,z_mm"]
    for i, (own, three) in enumerate(zip(np.degrees(q), read * 1e3, strict=True)):
        joints = ",".join(f"{angle:.4f}" for angle in own)
        lines += [
            f"p{i},m{j},{joints},{x:.6f},{y:.6f},{z:.6f}" for j, (x, y, z) in enumerate(three, 1)
        ]
    return "\n".join([*lines, ""])


def put(place: Path, text: str, *, kind: str = "arm", name: str = "measurements.csv") -> None:
    """A robot's folder with its cell, model and one table."""
    place.mkdir(parents=True, exist_ok=True)
    (place / "cell.toml").write_text(CELL.format(name=place.name))
    (place / "robot.urdf").write_text(urdf(kind))
    (place / name).write_text(text)
