"""Days without any cause: the arm scatters, much or little, and there is nothing to name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.arm.repeatability import usual_repeatability
from studies.research.benchmarks.conclusions.arms import KINDS, arm_of
from studies.research.benchmarks.conclusions.days import Day
from studies.research.benchmarks.conclusions.scenes import (
    random_poses,
    reflectors,
    scattering,
    scene_of,
)
from studies.research.withheld.robots import Arm
from studies.research.withheld.visible import at_rest

SIGMA = 10e-6
RATIOS = (0.5, 1.0, 2.0, 3.0)
LOUD = 10.0
_POSES = (40, 60)


def draw(rng: np.random.Generator, index: int) -> Day:
    """Scatter of .5, 1, 2 or 3 times the instrument's noise: every arm has its turn with each."""
    ratio = RATIOS[(index // 2 + index // 8) % len(RATIOS)]
    return _quiet(rng, index, f"{ratio:g} x", lambda _: ratio * SIGMA)


def draw_loud(rng: np.random.Generator, index: int) -> Day:
    """Ten times what data sheets of arms of that reach say."""
    return _quiet(rng, index, "10 x data sheet", lambda arm: LOUD * _by_data_sheets(arm))


def _quiet(rng: np.random.Generator, index: int, kind: str, size: Callable[[Arm], float]) -> Day:
    """In its joints on even days, at its tip on odd ones."""
    arm = arm_of(KINDS[index // 2 % len(KINDS)])
    q = random_poses(rng, arm, int(rng.integers(_POSES[0], _POSES[1] + 1)))
    scene = scene_of(rng, arm, q, reflectors(rng, arm), sigma=SIGMA)
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    scene = scattering(rng, scene, still, size(arm), in_joints=index % 2 == 0)
    return Day(kind, scene, mechanism, ratio=size(arm) / SIGMA)


def _by_data_sheets(arm: Arm) -> float:
    """Of one coordinate of the tip, m, and no less than the instrument's."""
    return max(SIGMA, usual_repeatability(reach(arm)).middle)


def reach(arm: Arm) -> float:
    """Length of the way from the first joint to the tip, m."""
    ways = [*(joint.xyz for joint in arm.joints[1:]), arm.tip_xyz]
    return float(np.sum(np.linalg.norm(ways, axis=1)))
