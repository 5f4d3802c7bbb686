"""A UR5e, a SCARA and an arm of seven axes: their makers' dimensions as files, and their truth.

Each real arm errs at every frame and has one cause that the user's model lacks: an eccentric gear, lost
motion, a soft joint. URDF and DH are composed in numpy alone, the seven axes are MuJoCo's.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arrays import Array

_H = np.pi / 2
_UR = (
    ("shoulder_pan", (0, 0, 0.1625), (0, 0, 0)),
    ("shoulder_lift", (0, 0, 0), (_H, 0, 0)),
    ("elbow", (-0.425, 0, 0), (0, 0, 0)),
    ("wrist_1", (-0.3922, 0, 0.1333), (0, 0, 0)),
    ("wrist_2", (0, -0.0997, 0), (_H, 0, 0)),
    ("wrist_3", (0, 0.0996, 0), (_H, np.pi, np.pi)),
)
_UR_SHAPES = (  # of the base and each link: what, where, turned
    ('<cylinder radius="0.075" length="0.1"/>', "0 0 0.05", "0 0 0"),
    ('<cylinder radius="0.06" length="0.16"/>', "0 0 0", "0 0 0"),
    ('<cylinder radius="0.055" length="0.5"/>', "-0.2125 0 0.136", "0 1.5708 0"),
    ('<cylinder radius="0.045" length="0.45"/>', "-0.1961 0 0.01", "0 1.5708 0"),
    ('<box size="0.08 0.08 0.11"/>', "0 0 -0.01", "0 0 0"),
    ('<cylinder radius="0.04" length="0.1"/>', "0 0 0", "0 0 0"),
    ('<sphere radius="0.04"/>', "0 0 -0.03", "0 0 0"),
)
_DH = ((0.0, 0.325, 0.342), (np.pi, 0.275, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))  # alpha, a, d
_SEVEN = (  # where each body stands, its turn (w, x, y, z), mass, centre of mass, range
    ((0, 0, 0.1575), "1 0 0 0", 5.76, "0 -0.03 0.12", 2.97),
    ((0, 0, 0.2025), "0 0 1 1", 6.35, "0 0.059 0.042", 2.09),
    ((0, 0.2045, 0), "0 0 1 1", 3.5, "0 0.03 0.13", 2.97),
    ((0, 0, 0.2155), "1 1 0 0", 3.5, "0 0.067 0.034", 2.09),
    ((0, 0.1845, 0), "0 0 -1 1", 3.5, "0 0.021 0.076", 2.97),
    ((0, 0, 0.2155), "1 1 0 0", 1.8, "0 0 0", 2.09),
    ((0, 0.081, 0), "0 0 1 1", 1.2, "0 0 0.02", 3.05),
)


def moved(xyz: Sequence[float], turn: Rotation) -> Array:
    """A frame, shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn.as_matrix(), xyz
    return frame


def _erring(error: Array) -> Array:
    return moved(error[:3], Rotation.from_rotvec(error[3:]))


def ur5e_urdf() -> str:
    links = [
        f'<link name="l{k}"><collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry>'
        "</collision></link>"
        for k, (shape, xyz, rpy) in enumerate(_UR_SHAPES)
    ]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(repr, rpy))}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3.1416" upper="3.1416" effort="150" velocity="3"/></joint>'
        for k, (name, xyz, rpy) in enumerate(_UR)
    ]
    return "\n".join(['<robot name="ur5e">', *links, *joints, "</robot>"])


def scara_dh() -> str:
    kinds = ("revolute", "revolute", "prismatic", "revolute")
    rows = (
        f"J{k},{kind},{np.degrees(alpha)},{a * 1e3},0,{d * 1e3}"
        for k, (kind, (alpha, a, d)) in enumerate(zip(kinds, _DH, strict=True), 1)
    )
    return "\n".join(["joint,kind,alpha_deg,a_mm,theta_deg,d_mm", *rows, ""])


def seven_mjcf() -> str:
    bodies = "".join(
        f'<body name="link{k}" pos="{" ".join(map(str, pos))}" quat="{quat}">'
        f'<inertial mass="{mass}" pos="{com}" diaginertia="0.02 0.02 0.01"/>'
        f'<joint name="A{k}" axis="0 0 1" range="-{reach} {reach}"/>'
        for k, (pos, quat, mass, com, reach) in enumerate(_SEVEN, 1)
    )
    return (
        '<mujoco model="seven"><compiler angle="radian"/><option gravity="0 0 -9.80665"/><worldbody>'
        f'<body name="base">{bodies}<site name="flange" pos="0 0 0.045"/>{"</body>" * 8}'
        "</worldbody></mujoco>"
    )


def ur5e(q: Array, errors: Array, sides: Array) -> Array:
    """Elbow on an eccentric gear: 250 cos q + 150 sin q, urad."""
    frame = _erring(errors[0])
    for k, (_, xyz, rpy) in enumerate(_UR):
        turn = q[k] + (k == 2) * (250e-6 * np.cos(q[k]) + 150e-6 * np.sin(q[k])) * errors.any()
        frame = frame @ moved(xyz, Rotation.from_euler("xyz", rpy)) @ _erring(errors[k + 1])
        frame = frame @ moved((0, 0, 0), Rotation.from_rotvec((0, 0, turn)))
    return frame


def scara(q: Array, errors: Array, sides: Array) -> Array:
    """J2 with a lost motion of 200 urad."""
    frame = np.eye(4)
    for k, (alpha, a, d) in enumerate(_DH):
        turn = (k != 2) * q[k] + (k == 1) * 100e-6 * sides[k] * errors.any()
        frame = frame @ _erring(errors[k])
        frame = frame @ moved((0, 0, d + (k == 2) * q[k]), Rotation.from_rotvec((0, 0, turn)))
        frame = frame @ moved((a, 0, 0), Rotation.from_rotvec((alpha, 0, 0)))
    return frame @ _erring(errors[4])


def seven(q: Array, errors: Array, sides: Array) -> Array:
    """A2 bends by 4 urad/(N m) under the weights of the arm."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(seven_mjcf())
    for k in range(7):
        at = model.body(f"link{k + 1}").id
        own = Rotation.from_quat(model.body_quat[at], scalar_first=True)
        model.body_pos[at] += own.apply(errors[k + 1, :3])
        turn = own * Rotation.from_rotvec(errors[k + 1, 3:])
        model.body_quat[at] = turn.as_quat(scalar_first=True)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    data.qpos[1] -= 4e-6 * data.qfrc_bias[1] * errors.any()
    mujoco.mj_forward(model, data)
    flange = data.site("flange")
    return moved(flange.xpos, Rotation.from_matrix(flange.xmat.reshape(3, 3)))


@dataclass(frozen=True, eq=False)
class Real:
    """An arm as it is: errors of its frames, its markers (M, 3), m, and where its base stands."""

    tip: Callable[[Array, Array, Array], Array]
    errors: Array
    markers: Array
    base: Array

    def points(self, q: Array) -> Array:
        """Markers in the instrument's frame, shape (m, M, 3), m; poses are visited in this order."""
        side, before, found = np.zeros(q.shape[1]), q[0], []
        for row in q:
            side = np.where(row == before, side, np.sign(row - before))
            before = row
            frame = self.base @ self.tip(row, self.errors, side)
            found.append(self.markers @ frame[:3, :3].T + frame[:3, 3])
        return np.array(found)

    def slipped(self, joint: int, by: float) -> Real:
        """The same with the zero of a joint off, rad or m."""
        off = np.eye(self.errors.shape[0])[joint] * by
        return replace(self, tip=lambda q, *rest: self.tip(q + off[: len(q)], *rest))

    def nominal(self, markers: Array, base: Array) -> Real:
        """The arm of its file, with markers and base as somebody found them."""
        return replace(self, errors=np.zeros_like(self.errors), markers=markers, base=base)


def real_arm(tip: Callable[[Array, Array, Array], Array], seed: int) -> Real:
    """0.3 mm and 0.4 mrad at every frame, markers off by 2 mm, the instrument anywhere."""
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(8, 6)) * np.repeat([3e-4, 4e-4], 3)
    markers = np.array([[0.05, 0, 0.03], [-0.025, 0.045, 0.03], [-0.025, -0.045, 0.03]])
    base = moved(rng.uniform(-3, 3, 3), Rotation.random(random_state=rng))
    return Real(tip, errors, markers + rng.normal(size=(3, 3)) * 2e-3, base)


def joints_of(table: Path) -> tuple[list[str], list[str], Array]:
    """Names of poses and of the joints' columns, and the joints, rad and m."""
    rows = list(csv.DictReader(table.read_text().splitlines()))
    ends = ("_mdeg", "_um", "before_mm", "left_mm", "expected_mm")
    columns = [c for c in rows[0] if c.endswith(("_deg", "_mm")) and not c.endswith(ends)]
    scale = [np.pi / 180 if c.endswith("_deg") else 1e-3 for c in columns]
    q = np.array([[float(row[c]) for c in columns] for row in rows]) * scale
    return [row["pose"] for row in rows], columns, q


def exported(names: Sequence[str], points: Array) -> str:
    """Points (m, M, 3), m, as a table of poses and markers."""
    rows = (
        f"{name},m{j}," + ",".join(f"{v:.6f}" for v in point)
        for name, markers in zip(names, points * 1e3, strict=True)
        for j, point in enumerate(markers, 1)
    )
    return "\n".join(["pose,marker,x_mm,y_mm,z_mm", *rows, ""])


def read(points: Array, seed: int) -> Array:
    """Read to 0.01 mm in each coordinate."""
    return np.asarray(points + np.random.default_rng(seed).normal(size=points.shape) * 1e-5)
