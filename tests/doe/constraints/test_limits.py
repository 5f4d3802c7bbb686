"""What the arm can do where it stands: torques against MuJoCo and the model, a load that hangs free."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calib import Cell
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Load
from doe.constraints import constraints_of, scene_of
from doe.constraints.limits import static_torques
from doe.constraints.scene import Scene
from tests.doe.constraints.arms import allowed, configurations, only, planar
from tests.helpers import GRAVITY


def test_torques_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    assert cell.load is not None
    tip, weight = model.body("tool").id, cell.load.mass * GRAVITY
    expected = np.empty((2, len(scene), 5))
    for n, data in enumerate(configurations(scene, model)):
        expected[:, n] = -data.qfrc_bias
        hook = data.xmat[tip].reshape(3, 3) @ cell.load.com + data.xpos[tip]
        mujoco.mj_applyFT(model, data, weight, np.zeros(3), hook, tip, expected[1, n])
    np.testing.assert_allclose(static_torques(scene), expected, atol=1e-6)
    allowed = {c.name: c for c in constraints_of(cell)}["joint_torque"].allows(scene)
    over = np.abs(expected) > np.nan_to_num(cell.robot.efforts, nan=1e9)
    np.testing.assert_array_equal(allowed, ~over.any(axis=(0, 2)))
    assert 0 < allowed.sum() < len(allowed)


def test_joint_torque() -> None:
    """Weights in the plane: 10 kg at 3 m, and 5 kg more with the load; 30 * 9 and 45 * 9 N m."""
    heavy = {"gravity": np.array([0.0, -9.0, 0.0]), "payload": Payload(10.0, (0.0, 0.0, 0.0))}
    efforts = np.array([300.0, np.nan, np.nan])
    cell = planar(efforts=efforts, **heavy)
    assert allowed(cell, (0, 0, 0), (90, 0, 0)) == [True, True]
    loaded = replace(cell, load=Load(5.0, (0.0, 0.0, 0.0)))
    assert allowed(loaded, (0, 0, 0), (90, 0, 0), (0, 120, 0)) == [False, True, True]
    # A load on the other side of the joint relieves it, and the free reading still counts.
    weak = replace(loaded, load=Load(5.0, (-9.0, 0.0, 0.0)))
    assert allowed(weak, (0, 0, 0)) == [True]
    weak = replace(weak, robot=replace(weak.robot, efforts=np.array([200.0, np.nan, np.nan])))
    assert static_torques(scene_of(weak, np.zeros((1, 3))))[:, 0, 0] == pytest.approx([-270, 0])
    assert allowed(weak, (0, 0, 0)) == [False]


def test_torque_that_cannot_act() -> None:
    weightless = planar(efforts=np.full(3, 10.0))
    assert constraints_of(weightless) == ()
    assert constraints_of(planar(masses=np.full(3, 5.0))) == ()
    assert only(planar(masses=np.full(3, 5.0), efforts=np.full(3, 10.0))).name == "joint_torque"
    with_load = replace(weightless, load=Load(1.0, (0, 0, 0)))
    assert only(with_load).name == "joint_torque"


@pytest.mark.parametrize("gravity", [GRAVITY, np.array([0.0, -9.0, 0.0])])
def test_hanging_load(gravity: Array) -> None:
    """Axes about z: gravity along z leaves the tip's x axis level, gravity along y does not."""
    cell = planar(load=Load(5.0, (0, 0, 0), np.radians(30.0)), gravity=gravity)
    q = ((0, 0, 0), (29.9, 0, 0), (90, -60, 0), (30.1, 0, 0), (-40, 0, 0), (150, 0, 0), (90, 90, 0))
    level = gravity[2] != 0.0
    steep = [True, True, True, level, level, True, True]
    assert allowed(cell, *q) == steep


def test_load_that_hangs_everywhere() -> None:
    cell = planar(load=Load(5.0, (0, 0, 0)), gravity=np.array([0.0, -9.0, 0.0]))
    assert constraints_of(cell) == ()
    limited = replace(cell, load=Load(5.0, (0, 0, 0), 0.1))
    assert only(limited).name == "hanging_load"
    assert constraints_of(replace(limited, gravity=np.zeros(3))) == ()
    assert constraints_of(replace(limited, load=None)) == ()
