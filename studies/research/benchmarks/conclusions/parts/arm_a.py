"""A UR-like arm on a track: two offsets that the model has, two causes that it lacks, and scatter."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
import doe
from studies.research.benchmarks.conclusions.arms import arm_of
from studies.research.benchmarks.conclusions.days import Day
from studies.research.benchmarks.conclusions.scenes import (
    as_shown,
    reflectors,
    scene_of,
    with_scatter,
)
from studies.research.benchmarks.conclusions.sizing import Visibility
from studies.research.benchmarks.conclusions.true_causes import TrueCause, joint_error, named
from studies.research.withheld.actions import State
from studies.research.withheld.case_files import cell_text
from studies.research.withheld.robots import Array
from studies.research.withheld.scatter import Scatter
from studies.research.withheld.scene import Scene
from studies.research.withheld.texts import urdf
from studies.research.withheld.visible import at_rest

POSES = 40
SIGMA = 15e-6
SCATTER = np.repeat([15e-6, 15e-6], 3)  # m and rad, of the tip
OFFSETS = {"elbow": 800e-6, "wrist_2": -500e-6}
COMPLIANCE = 3e-6  # rad/(N m)
ONCE, TWICE = (350e-6, 250e-6), 120e-6  # rad
_ARM = arm_of("ur_on_track")
_GUESSES = reflectors(np.random.default_rng(0), _ARM)


def draw(rng: np.random.Generator, index: int) -> Day:  # noqa: ARG001
    """One day; arm and plan are the same on all."""
    plain = frozenset[str]()  # neither clock nor thermometer
    scene = scene_of(rng, _ARM, plan(), _GUESSES, sigma=SIGMA, columns=plain, geometry=_geometry())
    scene = with_scatter(scene, Scatter(np.zeros(_ARM.dof), SCATTER))
    mechanism = scene.mechanism()
    visible = Visibility(scene, mechanism, at_rest(scene, mechanism, ()))
    return Day("arm_a", scene, mechanism, CAUSES, tuple(visible.beside(CAUSES)), ratio=1.0)


@lru_cache
def plan() -> Array:
    """Joints of the default plan, shape (40, 7), rad and m, as the files show them."""
    rng = np.random.default_rng(0)
    scene = scene_of(rng, _ARM, np.zeros((1, _ARM.dof)), _GUESSES, sigma=SIGMA)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.urdf").write_text(urdf(_ARM), encoding="utf-8")
        (folder / "cell.toml").write_text(cell_text("arm a", scene), encoding="utf-8")
        cell = calib.load_cell(folder / "cell.toml")
        return as_shown(_ARM, doe.design(cell, poses=POSES, reapproach=0).poses.q)


def _geometry() -> Array:
    """The offsets alone, as turns of the frames before their joints."""
    geometry = np.zeros((_ARM.dof + 2, 6))
    for joint, offset in OFFSETS.items():
        k = _ARM.names.index(joint)
        geometry[k + 1, 3:] = offset * _ARM.axes[k]
    return geometry


_LIFT, _WRIST = _ARM.names.index("shoulder_lift"), _ARM.names.index("wrist_1")


def _yields(scene: Scene, state: State) -> Array:  # noqa: ARG001
    return np.asarray(COMPLIANCE * state.torque[:, _LIFT])


def _gear(scene: Scene, state: State) -> Array:  # noqa: ARG001
    """Eccentric by so much, which is a sine with a phase; and twice a turn beside."""
    q = scene.session.q[:, _WRIST]
    eccentric, phase = np.hypot(*ONCE), np.arctan2(ONCE[1], ONCE[0])
    return np.asarray(eccentric * np.cos(q - phase) + TWICE * np.cos(2.0 * q))


CAUSES = (
    TrueCause(
        "compliance",
        "shoulder_lift",
        joint_error(_LIFT, _yields),
        named("shoulder_lift", "joint_compliance"),
    ),
    TrueCause(
        "gear", "wrist_1", joint_error(_WRIST, _gear), named("wrist_1", "transmission_harmonic")
    ),
)
