"""The parts of the benchmark: an arm with two causes, days without any, causes of no catalogue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
import doe
from calib.arm.repeatability import usual_repeatability
from studies.research.benchmarks.conclusions import foreign
from studies.research.benchmarks.conclusions.days import (
    ARM_KINDS,
    Day,
    NoSuchDay,
    TrueCause,
    Visibility,
    arm_of,
    as_shown,
    by_turns,
    drawn_noncentrality,
    joint_error,
    named,
    random_poses,
    scattering,
    scene_of,
    with_scatter,
)
from studies.research.benchmarks.conclusions.foreign import plain_day
from studies.research.benchmarks.day import reflectors
from studies.research.withheld.causes import outside_of
from studies.research.withheld.judge import HELD
from studies.research.withheld.keys import cell_text
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.scene import Scatter, Scene
from studies.research.withheld.truth import Action, State, urdf
from studies.research.withheld.visible import at_rest

POSES = 40
SIGMA = 15e-6
SCATTER = np.repeat([15e-6, 15e-6], 3)  # m and rad, of the tip
OFFSETS = {"elbow": 800e-6, "wrist_2": -500e-6}
COMPLIANCE = 3e-6  # rad/(N m)
ONCE, TWICE = (350e-6, 250e-6), 120e-6  # rad
_ARM = arm_of("ur_on_track")
_GUESSES = reflectors(np.random.default_rng(0), _ARM)


def draw_arm_a(rng: np.random.Generator, index: int) -> Day:  # noqa: ARG001
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


QUIET_SIGMA = 10e-6
RATIOS = (0.5, 1.0, 2.0, 3.0)
LOUD = 10.0
_READ_POSES = (40, 60)


def draw_nothing(rng: np.random.Generator, index: int) -> Day:
    """Scatter of .5, 1, 2 or 3 times the instrument's noise: every arm has its turn with each."""
    ratio = RATIOS[(index // 2 + index // 8) % len(RATIOS)]
    return _quiet(rng, index, f"{ratio:g} x", lambda _: ratio * QUIET_SIGMA)


def draw_loud(rng: np.random.Generator, index: int) -> Day:
    """Ten times what data sheets of arms of that reach say."""
    return _quiet(rng, index, "10 x data sheet", lambda arm: LOUD * _by_data_sheets(arm))


def _quiet(rng: np.random.Generator, index: int, kind: str, size: Callable[[Arm], float]) -> Day:
    """In its joints on even days, at its tip on odd ones."""
    arm = arm_of(ARM_KINDS[index // 2 % len(ARM_KINDS)])
    q = random_poses(rng, arm, int(rng.integers(_READ_POSES[0], _READ_POSES[1] + 1)))
    scene = scene_of(rng, arm, q, reflectors(rng, arm), sigma=QUIET_SIGMA)
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    scene = scattering(rng, scene, still, size(arm), in_joints=index % 2 == 0)
    return Day(kind, scene, mechanism, ratio=size(arm) / QUIET_SIGMA)


def _by_data_sheets(arm: Arm) -> float:
    """Of one coordinate of the tip, m, and no less than the instrument's."""
    return max(QUIET_SIGMA, usual_repeatability(reach(arm)).middle)


def reach(arm: Arm) -> float:
    """Length of the way from the first joint to the tip, m."""
    ways = [*(joint.xyz for joint in arm.joints[1:]), arm.tip_xyz]
    return float(np.sum(np.linalg.norm(ways, axis=1)))


OUTSIDE_KINDS = tuple(
    kind
    for kind in OUTSIDE
    if kind not in (*HELD, "marker_load")  # no load is hung on these days
)
_DRIVES = ("creep", "hardening_drive")


def _draw(rng: np.random.Generator, kind: str, scatters: bool) -> Day:
    day, still = plain_day(rng, kind, scatters)
    cause = _cause(rng, day.scene, kind)
    visible = Visibility(day.scene, day.mechanism, still)
    cause = visible.sized(cause, drawn_noncentrality(rng))
    return replace(day, causes=(cause,), noncentrality=(visible.alone(cause),))


def _cause(rng: np.random.Generator, scene: Scene, kind: str) -> TrueCause:
    """As the sealed cases draw_outside it. Raises NoSuchDay where this arm cannot have it."""
    soft = any(joint.compliance for joint in scene.arm.joints)
    if (kind in _DRIVES and not soft) or (kind.startswith("marker") and len(scene.markers) == 1):
        raise NoSuchDay
    drawn = outside_of(rng, scene, kind)

    def act(scene: Scene, state: State) -> Action:
        return OUTSIDE[kind].act(scene, state, drawn.where, drawn.values)

    return TrueCause(kind, drawn.where, act, ())


draw_outside = by_turns(OUTSIDE_KINDS, _draw)


Draw = Callable[[np.random.Generator, int], Day]
DRAWS: dict[str, Draw] = {
    "arm_a": draw_arm_a,
    "nothing": draw_nothing,
    "loud": draw_loud,
    "foreign": foreign.draw,
    "hard": foreign.draw_hard,
    "outside": draw_outside,
}
KINDS: dict[str, tuple[str, ...]] = {
    "foreign": foreign.KINDS,
    "hard": foreign.HARD_KINDS,
    "outside": OUTSIDE_KINDS,
}
"""Kinds that take turns from day to day."""
