"""An arm as the URDF that the user brings, and as the MJCF from which the truth is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.withheld.robots import Arm, Array

G = 9.80665  # m/s^2, along -z of the base


def urdf(arm: Arm, masses: bool = True) -> str:
    """The nominal robot; without masses where the user does not know them."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{arm.name}">', f'  <link name="{arm.base}"/>']
    parent = arm.base
    for index, joint in enumerate(arm.joints, 1):
        child, kind = f"link_{index}", "prismatic" if joint.slides else "revolute"
        lines.append(
            f'  <joint name="{joint.name}" type="{kind}">{_origin(joint.xyz, joint.rpy)}'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{_text(joint.axis)}"/>'
            f'<limit lower="{joint.low:.9g}" upper="{joint.high:.9g}" effort="0" velocity="0"/></joint>'
        )
        inertial = (
            f"<inertial>{_origin(joint.com)}"
            f'<mass value="{joint.mass:.9g}"/>'
            '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
            "</inertial>"
        )
        lines.append(f'  <link name="{child}">{inertial if masses else ""}</link>')
        parent = child
    lines.append(
        f'  <joint name="mount" type="fixed">{_origin(arm.tip_xyz, arm.tip_rpy)}'
        f'<parent link="{parent}"/><child link="{arm.tip}"/></joint>'
    )
    return "\n".join([*lines, f'  <link name="{arm.tip}"/>', "</robot>", ""])


def mjcf(arm: Arm, geometry: Array, markers: Array) -> str:
    """The arm with displaced joint frames: bodies base, one a link, tip; one site a marker.

    geometry : ndarray, shape (n + 2, 6), m and rad, displacement of each frame in its own axes
    markers : ndarray, shape (M, 3), m, true positions in the tip frame
    """
    lines = [
        '<mujoco><compiler angle="radian" fusestatic="false"/>',
        f'<option gravity="0 0 {-G}"/><worldbody>',
        f'<body name="frame_0" {_placed((0, 0, 0), (0, 0, 0), geometry[0])}>',
    ]
    for index, joint in enumerate(arm.joints, 1):
        lines.append(
            f'<body name="frame_{index}" {_placed(joint.xyz, joint.rpy, geometry[index])}>'
            f'<joint type="{"slide" if joint.slides else "hinge"}" axis="{_text(joint.axis)}"/>'
            # The inertia turns nothing here: the arm stands still.
            f'<inertial pos="{_text(joint.com)}" mass="{joint.mass!r}" diaginertia="1 1 1"/>'
        )
    lines.append(
        f'<body name="tip" {_placed(arm.tip_xyz, arm.tip_rpy, geometry[-1])}>'
        # Loads act at a body's centre of mass: a nanogram puts that at the tip's origin.
        '<inertial pos="0 0 0" mass="1e-12" diaginertia="1 1 1"/>'
    )
    lines += [f'<site name="m{i}" pos="{_text(m)}"/>' for i, m in enumerate(markers, 1)]
    return "\n".join([*lines, "</body>" * (arm.dof + 2), "</worldbody></mujoco>"])


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def _origin(xyz: Sequence[float], rpy: Sequence[float] = (0, 0, 0)) -> str:
    return (
        f'<origin xyz="{" ".join(f"{v:.9g}" for v in xyz)}" '
        f'rpy="{" ".join(f"{v:.9g}" for v in rpy)}"/>'
    )


def _placed(xyz: Sequence[float], rpy: Sequence[float], displaced: Array) -> str:
    turn = Rotation.from_euler("xyz", rpy)
    at = np.asarray(xyz) + turn.apply(displaced[:3])
    x, y, z, w = (turn * Rotation.from_rotvec(displaced[3:])).as_quat()
    return f'pos="{_text(at)}" quat="{_text((w, x, y, z))}"'
