"""What makes the day of a real arm hard, apart from its causes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from studies.research.withheld.draw import HELD_OUT, Conditions, scene_of_session
from studies.research.withheld.real.causes import RATIO
from studies.research.withheld.real.days import READINGS, draw_day
from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import at_rest

_VISITS = (0.45, 0.35, 0.20)  # shares of ``READINGS``
_POSES = {"once": (60, 150), "free and loaded": (40, 75), "thrice": (40, 50)}
_ONE_MARKER = (40, 80)


@dataclass(frozen=True)
class RealConditions(Conditions):
    """Those of the first families, and what real days add.

    visit : of ``READINGS``; one_marker : a single reflector
    background : fine gear ripples at all joints, each too small to be seen
    torques : the file shows measured joint torques; ratios_said : the cell gives the gear ratios
    grid : one joint stands at equal steps only
    """

    visit: str
    one_marker: bool
    background: bool
    torques: bool
    ratios_said: bool
    grid: bool


def draw_conditions(rng: np.random.Generator) -> RealConditions:
    """Each condition by itself, in fixed shares."""
    visit = str(rng.choice(list(READINGS), p=_VISITS))
    one_marker = rng.random() < 0.12
    low, high = _ONE_MARKER if one_marker and visit == "once" else _POSES[visit]
    missing = (None, "time", "temperature", "approach")[
        int(rng.choice(4, p=[0.7, 0.2, 0.05, 0.05]))
    ]
    return RealConditions(
        wrong_sigma=rng.random() < 0.10,
        outliers=rng.random() < 0.10,
        hidden=not one_marker and rng.random() < 0.15,
        configurations=int(rng.integers(low, high + 1)),
        known_geometry=rng.random() < 0.05,
        weighs=rng.random() > 0.10,
        payload=rng.random() < 0.35,
        missing=missing,
        range_noise=(None, "said", "unsaid")[int(rng.choice(3, p=[0.9, 0.05, 0.05]))],
        visit=visit,
        one_marker=one_marker,
        background=rng.random() < 0.5,
        torques=rng.random() < 0.3,
        ratios_said=rng.random() < 0.3,
        grid=rng.random() < 0.08,
    )


def draw_real_scene(rng: np.random.Generator, arm: Arm, conditions: RealConditions) -> Scene:
    """The arm's true parameters, the user's model of it, and the day; nothing scatters yet."""
    day = draw_day(
        rng,
        arm,
        conditions.visit,
        conditions.configurations,
        HELD_OUT,
        timed=conditions.missing != "time",
        known_start=conditions.missing != "approach",
        grid=conditions.grid,
    )
    scene = scene_of_session(rng, arm, conditions, day)
    if conditions.one_marker:
        scene = replace(scene, markers=scene.markers[:1], guesses=scene.guesses[:1])
    ratios = {j.name: int(rng.integers(*RATIO, endpoint=True)) for j in arm.joints if not j.slides}
    scene = replace(scene, ratios=ratios, ratios_said=conditions.ratios_said)
    return replace(scene, measured=_measured(rng, scene)) if conditions.torques else scene


def _measured(rng: np.random.Generator, scene: Scene) -> Array:
    """Torques as the drives show them, rounded as in the file: load, weight, friction, offset, noise.

    The links weigh here even where the user does not know it.
    """
    heavy = replace(scene, weighs=True)
    whole = Mechanism(scene.arm, scene.geometry, scene.markers)
    torque = at_rest(heavy, whole, ()).torque
    scale = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-3)
    friction = rng.uniform(0.1, 0.4, scene.arm.dof) * scale * scene.session.approach
    offset = rng.normal(size=scene.arm.dof) * 0.1 * scale
    noise = rng.normal(size=torque.shape) * 0.03 * scale
    return np.asarray(np.round(torque + friction + offset + noise, 4) + 0.0)
