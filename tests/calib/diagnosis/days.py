"""Days of measurement in MuJoCo, with any cause: truth that shares no code with the estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from studies.research.sealed.draw import Case
from studies.research.sealed.key import write_case
from studies.research.sealed.visible import Projector
from studies.research.truth.arms import ARMS
from studies.research.truth.conditions import EASY
from studies.research.truth.formulas import turned
from studies.research.truth.mechanism import Action, State
from studies.research.truth.scene import Scene, at_rest, draw_scene

PLAIN = replace(EASY, payload=True)
Act = Callable[[Scene, State], Action]
Day = tuple[Cell, Measurements, Measurements]


@dataclass(frozen=True)
class Truth:
    """Anything that moves the arm, so many times."""

    act: Act
    size: float = 1.0

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        action.add(self.act(scene, state), np.full(scene.count, self.size))


def joint_error(where: str, error: Callable[[Scene], Array]) -> Act:
    """A joint that is off by an error [rad or m] of shape (N,)."""
    return lambda scene, state: turned(scene, where, error(scene))


def settling(where: str) -> Act:
    """A servo read before it was at rest: it lacks a part of its last move."""
    return joint_error(where, lambda scene: -1e-4 * _last(scene, where))


def lost_motion(where: str) -> Act:
    """Backlash: the side from which the joint came, whatever the move."""
    return joint_error(
        where, lambda scene: 1e-4 * scene.session.approach[:, scene.arm.names.index(where)]
    )


def heavier_load(scene: Scene, state: State) -> Action:
    """The hung load is a little heavier than the table's wrench says."""
    action = scene.nothing()
    action.load[:, -1] += 0.06 * scene.wrench
    return action


def measured_day(
    folder: Path,
    act: Act,
    noncentrality: float,
    seed: int,
    arm: str = "light",
    *,
    payload: bool = True,
) -> Day:
    """A day's cell, readings and held-out readings, the cause sized to be so visible."""
    rng, conditions = np.random.default_rng(seed), replace(PLAIN, payload=payload)
    scene = draw_scene(rng, next(a for a in ARMS if a.name == arm), conditions)
    mechanism = scene.mechanism()
    seen = np.ones((scene.count, len(scene.markers)), dtype=bool)
    still = at_rest(scene, mechanism, ())
    projector = Projector(scene, still, seen & ~scene.session.held[:, None])
    truth = Truth(act)
    for _ in range(3):
        state = at_rest(scene, mechanism, [truth])  # type: ignore[list-item]
        left = projector.left(state.readings - still.readings)
        truth = replace(truth, size=truth.size * float(noncentrality / (left @ left)) ** 0.5)
    noisy = state.readings + scene.noise.coloured(
        rng.normal(size=state.readings.shape), state.readings
    )
    case = Case(
        "single", conditions, scene, (), (), (), noncentrality, state, state.readings, noisy, seen
    )
    write_case(folder / "day", case)
    cell = calib.load_cell(folder / "day" / "cell.toml")
    tables = (folder / "day" / name for name in ("measurements.csv", "heldout.csv"))
    data, heldout = (calib.load_measurements(cell, table) for table in tables)
    return cell, data, heldout


def _last(scene: Scene, where: str) -> Array:
    """The last move of a joint with its sign, shape (N,), rad or m."""
    k = scene.arm.names.index(where)
    return np.asarray(scene.session.approach[:, k] * scene.session.motion[:, k])
