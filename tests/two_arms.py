"""A robot with torso, two arms and a head, as URDF and cell; poses at which its head sees a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arrays import Array
from calib.cell.cell import Cell
from calib.poses import Poses, poses_at
from doe.constraints.scene import scene_of
from doe.constraints.sight import visible
from doe.views import NUMBERS, looking

ARM = ("0 1 0", "1 0 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0")
AWAY = ("0 {} 0.2", "0 0 0", "0.02 0 -0.3", "0 0 0", "0 0 -0.28", "0.01 0 0")
COMMON = ("hip", "bend")
"""Joints that carry both the head and the hands."""

PLATE = """[boards.plate]
on = "tip"
squares = [6, 5]
pitch_mm = 20
position_mm = [-40, -30, -20]
rpy_deg = [0, 0, 0]
"""
EYE = """[instruments.eye]
kind = "camera"
on = "head"
focal_px = 900
center_px = [640, 480]
image_px = [1280, 960]
sigma_px = 0.2
position_mm = [50, 0, 60]
rpy_deg = [-110, 0, -90]
"""


def urdf() -> str:
    """Six joints an arm, two of the torso and two of the head; every link weighs two kilograms."""
    joints = [
        ("hip", "base", "torso", "0 0 1", "0 0 0.4"),
        ("bend", "torso", "chest", "0 1 0", "0.05 0 0.3"),
        ("pan", "chest", "neck", "0 0 1", "0 0 0.35"),
        ("tilt", "neck", "head", "0 1 0", "0.03 0 0.1"),
    ]
    for side, y in (("right", -0.2), ("left", 0.2)):
        parent = "chest"
        for k, (axis, away) in enumerate(zip(ARM, AWAY, strict=True), 1):
            name = f"{side}{k}"
            joints.append((name, parent, f"{name}_link", axis, away.format(y)))
            parent = f"{name}_link"
        joints.append((f"{side}_wrist", parent, f"{side}_hand", "", "0 0 -0.1"))
    links = ["base", *(child for _, _, child, _, _ in joints)]
    return (
        '<robot name="pair">'
        + "".join(f'<link name="{link}">{_MASS}</link>' for link in links)
        + "".join(_joint(*own) for own in joints)
        + "</robot>"
    )


_MASS = (
    '<inertial><origin xyz="0 0 0.05"/><mass value="2"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
_LIMIT = '<limit lower="-1.5" upper="1.5" effort="100" velocity="1"/>'


def _joint(name: str, parent: str, child: str, axis: str, away: str) -> str:
    kind = "revolute" if axis else "fixed"
    turning = f'<axis xyz="{axis}"/>{_LIMIT}' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{away}"/>{turning}</joint>'
    )


def written(folder: Path, *tables: str, effects: str = '"base", "tool", "geometry"') -> Path:
    """The file of a cell of this robot, whose tip is the right hand, with these tables."""
    (folder / "pair.urdf").write_text(urdf())
    (folder / "cell.toml").write_text(
        'schema = 1\n[robot]\nurdf = "pair.urdf"\nbase = "base"\ntip = "right_hand"\n'
        f"{''.join(tables)}[model]\neffects = [{effects}]\n"
    )
    return folder / "cell.toml"


def in_view(cell: Cell, count: int, drawn: int = 3000) -> Poses:
    """Poses at which every reading of a cell with one camera and one board is had."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.4, 1.4, (drawn, cell.robot.dof))
    free = np.ones(cell.robot.dof, dtype=bool)
    even = rng.uniform(size=(drawn, NUMBERS))
    q = looking(cell, q, np.zeros(drawn, dtype=int), even, free)
    seen: Array = q[visible(scene_of(cell, q)).all(axis=1)]
    assert len(seen) >= count
    return poses_at(seen[:count])
