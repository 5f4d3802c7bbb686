"""Small days of real arms for the tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.research.withheld.draw import scene_of_session
from studies.research.withheld.real_arms import RealConditions
from studies.research.withheld.robots import Arm
from studies.research.withheld.scene import Scene
from studies.research.withheld.session import draw_day
from tests.studies.research.withheld.scenes import PLAIN

HELD_OUT = 6


def day_of(
    arm: Arm,
    visit: str = "once",
    missing: str | None = None,
    configurations: int = 14,
    seed: int = 0,
) -> Scene:
    """A scene without geometric errors whose instrument stands in the base, nothing scatters."""
    rng = np.random.default_rng(seed)
    day = draw_day(
        rng,
        arm,
        visit,
        configurations,
        HELD_OUT,
        timed=missing != "time",
        known_start=missing != "approach",
        grid=False,
    )
    conditions = RealConditions(
        **{**PLAIN.__dict__, "missing": missing, "configurations": configurations},
        visit=visit,
        one_marker=False,
        background=False,
        torques=False,
        ratios_said=False,
        grid=False,
    )
    scene = scene_of_session(rng, arm, conditions, day)
    ratios = {joint.name: 100 for joint in arm.joints if not joint.slides}
    return replace(scene, markers=scene.guesses, R=np.eye(3), p=np.zeros(3), ratios=ratios)
