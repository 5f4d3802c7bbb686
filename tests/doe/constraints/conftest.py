"""Arms that MuJoCo knows too."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from calib import Cell
from doe.constraints import scene_of
from doe.constraints.scene import Scene
from tests.doe.constraints.arms import in_mujoco, shaped

ARMS = [(20, ()), (23, (1,)), (24, (0, 3))]


@pytest.fixture(params=ARMS, ids=["revolute", "slides at 2", "slides at 1 and 4"], scope="module")
def arm(request: pytest.FixtureRequest) -> tuple[Cell, Scene, mujoco.MjModel]:
    cell = shaped(*request.param)
    q = np.random.default_rng(5).uniform(*cell.robot.sample_limits().T, (150, 5))
    return cell, scene_of(cell, q), in_mujoco(cell)
