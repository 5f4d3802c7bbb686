"""Arms as MJCF, written by chance in every way that the format allows."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array


def text(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def random_mjcf(rng: np.random.Generator, dof: int, tip: str = "site") -> str:
    """A chain from body ``base`` to ``tip`` with joints j1 .. jn, branches and a scene around it.

    The tip is a site, a body without joints, or the last link.

    Several joints a body or none, off its origin; frames, defaults, every way to write an angle;
    masses from inertials and from shapes, and of bodies fixed to the links.
    """
    degrees, joint = bool(rng.integers(2)), 0
    unit = 180 / np.pi if degrees else 1.0
    order = "".join(rng.permutation(list("xyz" if rng.integers(2) else "XYZ")))
    lines = [
        f'<mujoco model="random"><compiler angle="{"degree" if degrees else "radian"}" '
        f'eulerseq="{order}" autolimits="true"/>',
        '<default><default class="link"><joint axis="0 1 0" armature="0.1"/>'
        '<geom type="capsule" size="0.03 0.1" density="500" material="grey"/></default></default>',
        '<asset><material name="grey"/></asset>',
        '<option gravity="0 0 -9.80665"/><visual><map znear="0.01"/></visual>',
        '<worldbody><light pos="0 0 3"/><geom type="plane" size="1 1 1"/>'
        f'<body name="base" {pose(rng, unit)} childclass="link"><!-- bolted down -->'
        '<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>'
        '<body name="lamp"><joint name="lamp"/><geom/></body>',
    ]
    closing: list[str] = []
    while joint < dof:
        here = min(int(rng.integers(0, 4)), dof - joint)
        if rng.integers(3) == 0:
            lines.append(f"<frame {pose(rng, unit)}>")
            closing.append("</frame>")
        name = f'name="body_{joint}_{len(closing)}"' if rng.integers(2) else ""
        name = 'name="tip"' if tip == "link" and joint + here == dof else name
        lines.append(f"<body {name} {pose(rng, unit)}>")
        closing.append("</body>")
        for _ in range(here):
            joint += 1
            lines.append(random_joint(rng, joint, unit))
        lines.append(
            f'<inertial pos="{text(rng.normal(size=3) * 0.1)}" mass="{rng.uniform(1, 9)!r}" '
            'diaginertia="1 1 1"/>'
            if rng.integers(2)
            else f"<geom {pose(rng, unit)}/><frame {pose(rng, unit)}><geom/></frame>"
        )
        lines.append(
            f"<body {pose(rng, unit)}><joint/><geom/><body {pose(rng, unit)}>"
            f'<frame {pose(rng, unit)}><joint type="slide"/></frame><geom/></body></body>'
        )
        if rng.integers(2):
            lines.append(
                f"<frame {pose(rng, unit)}><body {pose(rng, unit)}><geom/><body {pose(rng, unit)}>"
                '<geom type="box" size="0.1 0.2 0.1"/></body></body></frame>'
            )
    if tip == "site":
        lines.append(f'<frame {pose(rng, unit)}><site name="tip" {pose(rng, unit)}/></frame>')
    elif tip == "body":
        lines.append(f'<body name="tip" {pose(rng, unit)}>')
        closing.append("</body>")
    lines.append('<body name="finger"><joint name="finger" type="slide"/><geom/></body>')
    return "\n".join([*lines, *closing[::-1], "</body></worldbody></mujoco>", ""])


def random_joint(rng: np.random.Generator, number: int, unit: float) -> str:
    slides = rng.integers(4) == 0
    unit = 1.0 if slides else unit
    words = [f'name="j{number}"', f'type="{"slide" if slides else "hinge"}"']
    words += [f'axis="{text(rng.normal(size=3))}"'] if rng.integers(2) else []
    words += [f'pos="{text(rng.normal(size=3) * 0.3)}"'] if rng.integers(2) else []
    words += [f'ref="{rng.normal() * unit!r}"'] if rng.integers(2) else []
    words += [f'range="{-2 * unit!r} {3 * unit!r}"'] if rng.integers(2) else []
    words += ['actuatorfrcrange="-50 60"'] if rng.integers(2) else []
    joint = f"<joint {' '.join(words)}/>"
    return f"<frame {pose(rng, unit)}>{joint}</frame>" if rng.integers(4) == 0 else joint


def pose(rng: np.random.Generator, unit: float) -> str:
    """A position, and a rotation in one of the ways of MJCF."""
    turned = rng.normal(size=3) * unit
    x = rng.normal(size=3)
    ways = [
        "",
        f'quat="{text(rng.normal(size=4))}"',
        f'euler="{text(turned)}"',
        f'axisangle="{text(x)} {text(turned[:1])}"',
        f'xyaxes="{text(x)} {text(np.cross(x, turned))}"',
        f'zaxis="{text(x)}"',
    ]
    return f'pos="{text(rng.uniform(-0.5, 0.5, 3))}" {ways[rng.integers(len(ways))]}'
