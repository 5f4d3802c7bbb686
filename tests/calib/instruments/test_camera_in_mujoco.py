"""The pixels of cameras in the world and on an arm, against the frustum of MuJoCo's own cameras.

MuJoCo moves the arm, its cameras and the points of the boards; what its renderer would draw of a point
follows from the frustum that it hands to OpenGL. That the renderer does so is seen in
``tests/calib/files/test_images.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from calib.model.build import build
from calib.poses import poses_at

mujoco = pytest.importorskip("mujoco")
SIZE = (1280, 960)
LENSES = {"wall": (1310.0, 1290.0, 25.0, -14.0), "eye": (905.0, 910.0, -31.0, 12.0)}
PLACES = {  # x, y, z [m], roll, pitch, yaw [rad]: cameras as OpenCV's, z ahead
    "wall": (2.4, 0.3, 0.9, -1.6, 0.1, 1.5),
    "eye": (0.05, -0.02, 0.1, 0.2, -0.15, 0.3),
    "grip": (0.06, 0.04, 0.12, 0.5, 0.4, -0.2),
    "bench": (0.5, 0.1, 2.4, 0.3, 0.2, 0.5),
}
GRID = np.array([[x, y, 0.0] for y in range(3) for x in range(4)]) * 0.03
ARM = """<mujoco><worldbody><body name="base"><geom size=".01" mass="1"/>
<camera name="wall" {wall}/>{bench}
<body name="a" pos="0 0 .3"><joint name="j1" axis="0 0 1" range="-3 3"/><geom size=".01" mass="1"/>
<body name="b" pos=".1 0 .2"><joint name="j2" axis="0 1 0" range="-3 3"/><geom size=".01" mass="1"/>
<body name="tip" pos=".5 0 .05" euler="10 20 -30"><joint name="j3" axis="1 0 0" range="-3 3"/>
<geom size=".01" mass="1"/><camera name="eye" {eye}/>{grip}</body></body></body></body></worldbody>
</mujoco>"""


def frame(name: str) -> tuple[Array, Array]:
    x, y, z, *rpy = PLACES[name]
    return Rotation.from_euler("xyz", rpy).as_matrix(), np.array([x, y, z])


def words(*values: float) -> str:
    return " ".join(f"{v:.12g}" for v in values)


def camera(name: str) -> str:
    """Its y goes up and its z back; its principal point counts back to the middle of the image."""
    (R, t), (fx, fy, cx, cy) = frame(name), LENSES[name]
    return (
        f'pos="{words(*t)}" xyaxes="{words(*R[:, 0], *-R[:, 1])}" resolution="{words(*SIZE)}" '
        f'sensorsize="0.0128 0.0096" focalpixel="{words(fx, fy)}" principalpixel="{words(cx, cy)}"'
    )


def sites(name: str) -> str:
    R, t = frame(name)
    placed = enumerate(GRID @ R.T + t)
    return "".join(f'<site name="{name}{k}" pos="{words(*p)}"/>' for k, p in placed)


def placed(name: str) -> str:
    R, t = frame(name)
    rpy = Rotation.from_matrix(R).as_euler("xyz", degrees=True)
    return f"position_mm = {(1e3 * t).tolist()}\nrpy_deg = {rpy.tolist()}\n"


def cell_text() -> Iterator[str]:
    yield 'schema = 1\n[robot]\nmjcf = "arm.xml"\nbase = "base"\ntip = "tip"\n'
    points = ", ".join(f"p{k} = {(1e3 * p).tolist()}" for k, p in enumerate(GRID))
    for name, on in (("grip", "tip"), ("bench", "world")):
        yield f'[boards.{name}]\non = "{on}"\npoints_mm = {{ {points} }}\n{placed(name)}'
    for name, on in (("wall", "world"), ("eye", "tip")):
        fx, fy, cx, cy = LENSES[name]
        middle = [(n - 1) / 2.0 + c for n, c in zip(SIZE, (-cx, -cy), strict=True)]
        yield f'[instruments.{name}]\nkind = "camera"\non = "{on}"\nfocal_px = {[fx, fy]}\n'
        yield f"center_px = {middle}\nsigma_px = 0.2\n{placed(name)}"
    yield '[model]\neffects = ["base", "tool"]\n'


def drawn(model: Any, data: Any, name: str, points: Array) -> Array:
    """Pixels (n, 2) at which the renderer draws points (n, 3), m; centres have whole numbers."""
    scene, view = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(name).id
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, everything, scene)
    left, right = scene.camera
    ray = points - (left.pos + right.pos) / 2.0
    ahead, up = np.array(left.forward, dtype=float), np.array(left.up, dtype=float)
    assert (ray @ ahead > 0.1).all()
    near = left.frustum_near / (ray @ ahead)
    x, y = ray @ np.cross(ahead, up) * near, ray @ up * near
    width, center = left.frustum_width, (left.frustum_center + right.frustum_center) / 2.0
    u = (x - center + width) / (2.0 * width) * SIZE[0]
    v = (left.frustum_top - y) / (left.frustum_top - left.frustum_bottom) * SIZE[1]
    return np.column_stack([u, v]) - 0.5


def test_pixels_are_where_mujoco_draws_them(tmp_path: Path) -> None:
    text = ARM.format(
        wall=camera("wall"), eye=camera("eye"), grip=sites("grip"), bench=sites("bench")
    )
    (tmp_path / "arm.xml").write_text(text)
    (tmp_path / "cell.toml").write_text("".join(cell_text()))
    cell = calib.load_cell(tmp_path / "cell.toml")
    poses = poses_at(np.random.default_rng(8).uniform(-0.3, 0.3, (6, 3)))
    model = build(cell, poses).model
    found = model.predict(model.initial, poses)
    names = model.channel_names
    arm = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(arm)
    for i, q in enumerate(poses.q):
        data.qpos[:] = q
        mujoco.mj_forward(arm, data)
        for name, board in (("wall", "grip"), ("eye", "bench")):
            points = np.array([data.site(f"{board}{k}").xpos for k in range(len(GRID))])
            own = [names.index(f"{board}:p{k}") for k in range(len(GRID))]
            pixels = drawn(arm, data, name, points)
            # The frustum is kept in single precision.
            np.testing.assert_allclose(found[i, own], pixels, atol=5e-4)
