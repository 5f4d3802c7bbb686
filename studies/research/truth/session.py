"""What is driven and when: joints, loads, clock, thermometer, direction of approach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from studies.research.truth.arms import Arm, Array, Mask
from studies.research.truth.conditions import PAIRED, READINGS, Conditions

READING_S = 45.0
_REVISITED = (2, 4)  # configurations that are visited three times, of a few and of many
_GRID_DEG = (5.0, 10.0, 15.0)
Visits = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Session:
    """N readings in order of time.

    names : identifiers
    q : ndarray, shape (N, n), rad or m, as the controller reads them
    held : ndarray of bool, shape (N,), readings of the hold-out
    force : ndarray, shape (N, 3), N, of the hung load, base axes
    hang : ndarray, shape (3,), m, where it hangs in the tip frame
    time, temperature : ndarray, shape (N,), s and degC
    approach : ndarray, shape (N, n), sign of each joint's last motion
    motion : ndarray, shape (N, n), size of the move before, rad or m
    pause : reading before which the arm stood so long that it came to rest there, None without
    """

    names: tuple[str, ...]
    q: Array
    held: Mask
    force: Array
    hang: Array
    time: Array
    temperature: Array
    approach: Array
    motion: Array
    pause: int | None = None

    def __len__(self) -> int:
        return len(self.names)

    @property
    def visit(self) -> Visits:
        """Number of the approach of each reading, shape (N,): readings without a move share one."""
        moved = np.any(np.diff(self.q, axis=0, prepend=self.q[:1]) != 0.0, axis=1)
        return np.cumsum(moved)

    @property
    def moves(self) -> Array:
        """How far each joint went in the arm's last move, with its sign, shape (N, n), rad or m.

        Zero before the first move and after a pause; a reading without a move keeps that of the
        reading before.
        """
        step = np.diff(self.q, axis=0, prepend=self.q[:1])
        arrived: Mask = np.any(step != 0.0, axis=1)
        if self.pause is not None:
            step[self.pause], arrived[self.pause] = 0.0, True
        row = np.where(arrived, np.arange(len(self)), 0)
        return np.asarray(step[np.maximum.accumulate(row)])

    @property
    def hours(self) -> Array:
        """Time since the first reading, shape (N,), h."""
        return np.asarray((self.time - self.time[0]) / 3600.0)


def draw_session(
    rng: np.random.Generator, arm: Arm, conditions: Conditions, held_out: int
) -> Session:
    """Readings of all configurations, some of which are visited three times.

    Where the files have no clock the hold-out follows the others after a rest, and the pace is even,
    so that the order of the rows is a clock; else, and in pairs, it lies between the others. Where they
    have no approach the joints rest at first, so that the order of the readings tells it.
    """
    count, paired = conditions.configurations, conditions.visit == PAIRED
    apart = conditions.missing == "time" and not paired
    joints = draw_configurations(rng, arm, count + held_out)
    if conditions.grid:
        joints = _on_a_grid(rng, arm, joints)
    again = np.repeat(np.arange(_REVISITED[count > 20] * (conditions.visit != "thrice")), 2)
    visits = np.concatenate([np.arange(count + held_out), again])
    visits = in_any_order(rng, visits) if paired else _from_a_fitted_one(rng, visits, count, apart)
    per = READINGS[conditions.visit]
    loaded = np.tile([False, True], len(visits))
    if not paired:
        drawn = np.repeat(rng.random(len(visits)) < 0.5, per)
        loaded = loaded if conditions.visit == "free and loaded" else drawn
    config = np.repeat(visits, per)
    paces = np.full(len(config), READING_S) if apart else rng.uniform(30.0, 60.0, len(config))
    time, q, held = np.cumsum(paces).round(1), joints[config], config >= count
    approach, motion = approaches(rng, q, conditions.missing != "approach")
    return Session(
        names=tuple(
            f"p{c:03d}_{'loaded' if load else 'free'}_{i:03d}"
            for i, (c, load) in enumerate(zip(config, loaded, strict=True))
        ),
        q=q,
        held=held,
        force=np.outer(np.where(loaded, -arm.load, 0.0), [0.0, 0.0, 1.0]),
        hang=np.round(rng.uniform(-0.6, 0.6, 3) * arm.tool, 4),
        time=time,
        temperature=draw_temperature(rng, time),
        approach=approach,
        motion=motion,
        pause=int(np.argmax(held)) if apart else None,
    )


def draw_configurations(rng: np.random.Generator, arm: Arm, total: int) -> Array:
    """Joints within their limits, shape (total, n), rad or m, in half of the cases evenly spread."""
    low, high = arm.limits.T
    if rng.random() < 0.5:
        unit = rng.random((total, arm.dof))
    else:
        unit = qmc.Sobol(arm.dof, scramble=True, rng=rng).random(1 << (total - 1).bit_length())
        unit = unit[rng.permutation(len(unit))[:total]]
    return as_shown(arm, low + unit * (high - low))


def as_shown(arm: Arm, q: Array) -> Array:
    """Rounded as the file will show them (1e-6 deg, 1e-6 mm), so that file and truth agree."""
    unit = np.where(arm.slides, 1e-3, np.pi / 180.0)
    return np.asarray(np.round(q / unit, 6) * unit)


def in_any_order(rng: np.random.Generator, visits: Visits) -> Visits:
    """Visits in an order in which none follows itself."""
    while True:
        order = rng.permutation(visits)
        if np.all(np.diff(order)):
            return order


def _from_a_fitted_one(
    rng: np.random.Generator, visits: Visits, configurations: int, apart: bool
) -> Visits:
    """An order that begins with a pose that is fitted: there the clocks of all begin."""
    while True:
        order = in_any_order(rng, visits)
        if apart:
            order = order[np.argsort(order >= configurations, kind="stable")]
        if order[0] < configurations and np.all(np.diff(order)):
            return order


def _on_a_grid(rng: np.random.Generator, arm: Arm, joints: Array) -> Array:
    """The same with one turning joint at whole multiples of some degrees."""
    k = int(rng.choice(np.flatnonzero(~arm.slides)))
    step = float(rng.choice(_GRID_DEG))
    low, high = np.degrees(arm.limits[k])
    within = np.ceil(low / step), np.floor(high / step)
    even = joints.copy()
    even[:, k] = np.radians(np.clip(np.round(np.degrees(joints[:, k]) / step), *within) * step)
    return even


def draw_temperature(rng: np.random.Generator, time: Array) -> Array:
    """Up and down within the session: heat must not look like time."""
    phase = 2.0 * np.pi * (rng.uniform(1.2, 2.6) * time / time[-1] + rng.random())
    swing, ramp = rng.uniform(2.0, 4.0), rng.uniform(-1.5, 1.5)
    value = rng.uniform(19.0, 24.0) + swing * np.sin(phase) + ramp * time / time[-1]
    return np.asarray(np.round(value, 3))


def approaches(rng: np.random.Generator, q: Array, known_start: bool) -> tuple[Array, Array]:
    """Sign of each joint's last motion and size of the move before each reading, shape (N, n)."""
    approach, motion = np.zeros_like(q), np.zeros_like(q)
    if known_start:
        approach[0] = rng.choice([-1.0, 1.0], q.shape[1])
    for i in range(1, len(q)):
        step = q[i] - q[i - 1]
        moved = np.abs(step) > 1e-7
        approach[i] = np.where(moved, np.sign(step), approach[i - 1])
        motion[i] = np.where(moved, np.abs(step), motion[i - 1])
    return approach, motion
