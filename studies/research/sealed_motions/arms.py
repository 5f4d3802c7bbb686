"""Three arms with inertials: as MuJoCo has them, and as their files say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]
_HALF = np.pi / 2.0


@dataclass(frozen=True)
class Link:
    """A link and the joint about z that moves it.

    xyz, rpy : origin in the link before it, m and rad; com : m; inertia : principal, about com, kg m^2
    """

    xyz: Triple
    rpy: Triple
    mass: float
    com: Triple
    inertia: Triple


@dataclass(frozen=True)
class Arm:
    """A serial arm whose joints turn.

    ratio : turns of a motor for one of its joint; reach : rad, of motions about zero; speed : rad/s
    """

    name: str
    links: tuple[Link, ...]
    ratio: float
    reach: float
    speed: float

    @property
    def joints(self) -> list[str]:
        """Names."""
        return [f"j{k}" for k in range(1, len(self.links) + 1)]

    def with_inertials(self, factors: Array, shifts: Array) -> Arm:
        """With other masses and inertias, factors (n,), and centres of mass, shifts (n, 3), m."""
        links = [
            replace(
                link,
                mass=link.mass * f,
                com=tuple(np.add(link.com, d)),
                inertia=tuple(np.multiply(link.inertia, f)),
            )
            for link, f, d in zip(self.links, factors.tolist(), shifts, strict=True)
        ]
        return replace(self, links=tuple(links))


ARMS = (
    Arm("light6", (
        Link((0, 0, .18), (0, 0, 0), 7.4, (.02, 0, .03), (.03, .03, .02)),
        Link((0, 0, 0), (_HALF, 0, 0), 13.0, (-.24, .01, .15), (.05, .42, .42)),
        Link((-.61, 0, 0), (0, 0, 0), 4.0, (-.28, .01, .06), (.01, .11, .11)),
        Link((-.57, 0, .17), (0, 0, 0), 2.0, (.01, -.02, .01), (.003, .003, .003)),
        Link((0, -.12, 0), (_HALF, 0, 0), 2.0, (.01, .02, .01), (.003, .003, .003)),
        Link((0, .12, 0), (-_HALF, 0, 0), .6, (.02, .01, -.03), (.0006, .0006, .0005)),
    ), 101.0, 1.2, 1.5),
    Arm("light7", (
        Link((0, 0, .34), (0, 0, 0), 4.0, (.01, -.03, -.07), (.02, .02, .01)),
        Link((0, 0, 0), (-_HALF, 0, 0), 4.5, (.01, -.06, .04), (.03, .02, .03)),
        Link((0, -.4, 0), (_HALF, 0, 0), 3.0, (.01, .03, -.09), (.02, .02, .008)),
        Link((0, 0, 0), (_HALF, 0, 0), 2.8, (.01, .07, .03), (.02, .01, .02)),
        Link((0, .39, 0), (-_HALF, 0, 0), 1.8, (.01, .02, -.1), (.01, .01, .004)),
        Link((0, 0, 0), (-_HALF, 0, 0), 1.9, (.02, .01, .01), (.004, .004, .004)),
        Link((0, -.08, 0), (_HALF, 0, 0), .9, (.03, .02, .05), (.002, .002, .001)),
    ), 160.0, 1.1, 1.3),
    Arm("heavy6", (
        Link((0, 0, .43), (0, 0, 0), 180.0, (.1, -.05, .05), (6.0, 7.0, 5.0)),
        Link((.3, 0, .2), (-_HALF, 0, 0), 120.0, (.02, -.45, .1), (14.0, 2.0, 14.0)),
        Link((0, -1.0, 0), (0, 0, 0), 90.0, (.2, -.12, .02), (2.0, 3.0, 3.0)),
        Link((.4, -.2, 0), (0, _HALF, 0), 40.0, (.01, .02, .4), (2.2, 2.2, .4)),
        Link((0, 0, .7), (0, -_HALF, 0), 14.0, (.04, .01, .02), (.1, .15, .12)),
        Link((.1, 0, 0), (0, _HALF, 0), 5.0, (.03, .01, .04), (.03, .03, .02)),
    ), 140.0, .8, 1.0),
)  # fmt: skip


def mjcf(arm: Arm, payload: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> str:
    """The arm for MuJoCo; payload : kg and place on the last link, m."""
    text, end = "", ""
    for name, link in zip(arm.joints, arm.links, strict=True):
        text += (
            f'<body pos="{_v(link.xyz)}" euler="{_v(link.rpy)}"><joint name="{name}" axis="0 0 1"/>'
            f'<inertial pos="{_v(link.com)}" mass="{float(link.mass)!r}" '
            f'diaginertia="{_v(link.inertia)}"/>'
        )
        end += "</body>"
    if payload[0] > 0.0:
        text += (
            f'<body pos="{_v(payload[1:])}"><inertial pos="0 0 0" mass="{float(payload[0])!r}" '
            'diaginertia="1e-6 1e-6 1e-6"/></body>'
        )
    return (
        '<mujoco><compiler angle="radian" eulerseq="XYZ" boundmass="0" boundinertia="0"/>'
        f'<option gravity="0 0 -9.80665"/><worldbody>{text}{end}</worldbody></mujoco>'
    )


def urdf(arm: Arm) -> str:
    """The arm as its file has it."""
    text, parent = f'<robot name="{arm.name}"><link name="base"/>', "base"
    for name, link in zip(arm.joints, arm.links, strict=True):
        x, y, z = link.inertia
        text += (
            f'<link name="{name}_link"><inertial><origin xyz="{_v(link.com)}" rpy="0 0 0"/>'
            f'<mass value="{link.mass!r}"/><inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" '
            f'ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="revolute">'
            f'<origin xyz="{_v(link.xyz)}" rpy="{_v(link.rpy)}"/><parent link="{parent}"/>'
            f'<child link="{name}_link"/><axis xyz="0 0 1"/>'
            '<limit lower="-3.1" upper="3.1" velocity="3" effort="0"/></joint>'
        )
        parent = f"{name}_link"
    return text + "</robot>"


def _v(values: Sequence[float]) -> str:
    return " ".join(repr(float(v)) for v in values)
