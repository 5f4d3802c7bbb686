"""What is driven and when: joints, loads, clock, thermometer, direction of approach."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from studies.research.withheld.robots import Arm, Array


@dataclass(frozen=True, eq=False)
class Session:
    """N readings in order of time.

    names : identifiers
    q : ndarray, shape (N, n), rad or m, as the controller reads them
    held : ndarray of bool, shape (N,), readings of the hold-out
    force : ndarray, shape (N, 3), N, of the hung load, base axes
    hang : ndarray, shape (3,), m, where it hangs in the tip frame
    time : ndarray, shape (N,), s
    temperature : ndarray, shape (N,), degC
    approach : ndarray, shape (N, n), sign of each joint's last motion
    motion : ndarray, shape (N, n), size of the move before, rad or m
    pause : reading before which the arm stood so long that it came to rest there, None without
    """

    names: tuple[str, ...]
    q: Array
    held: NDArray[np.bool_]
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
    def visit(self) -> NDArray[np.int_]:
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
        arrived: NDArray[np.bool_] = np.any(step != 0.0, axis=1)
        if self.pause is not None:
            step[self.pause], arrived[self.pause] = 0.0, True
        row = np.where(arrived, np.arange(len(self)), 0)
        moves: Array = step[np.maximum.accumulate(row)]
        return moves

    @property
    def hours(self) -> Array:
        """Time since the first reading, shape (N,), h."""
        hours: Array = (self.time - self.time[0]) / 3600.0
        return hours


def draw_session(
    rng: np.random.Generator, arm: Arm, configurations: int, held_out: int, known_start: bool
) -> Session:
    """Free and loaded readings of each configuration, four of them three times.

    known_start : the file tells the approach; else the joints rest at first, so that the order of the
        readings tells it
    """
    total = configurations + held_out
    joints = draw_configurations(rng, arm, total)
    repeated = np.arange(4 if configurations > 20 else 2)
    visits = np.concatenate([np.arange(total), np.repeat(repeated, 2)])
    visits = in_any_order(rng, visits)
    config = np.repeat(visits, 2)
    loaded = np.tile([False, True], len(visits))
    time = np.cumsum(rng.uniform(30.0, 60.0, len(config))).round(1)
    return _session(rng, arm, joints, config, config >= configurations, loaded, time, known_start)


def _session(
    rng: np.random.Generator,
    arm: Arm,
    joints: Array,
    config: NDArray[np.int_],
    held: NDArray[np.bool_],
    loaded: NDArray[np.bool_],
    time: Array,
    known_start: bool,
) -> Session:
    """Readings of configurations in order; approach, load and temperature are drawn."""
    q, force = joints[config], np.zeros((len(config), 3))
    force[loaded, 2] = -arm.load
    approach, motion = approaches(rng, q, known_start)
    return Session(
        names=tuple(
            f"p{c:03d}_{'loaded' if load else 'free'}_{i:03d}"
            for i, (c, load) in enumerate(zip(config, loaded, strict=True))
        ),
        q=q,
        held=held,
        force=force,
        hang=np.round(rng.uniform(-0.6, 0.6, 3) * arm.tool, 4),
        time=time,
        temperature=draw_temperature(rng, time),
        approach=approach,
        motion=motion,
    )


def draw_configurations(rng: np.random.Generator, arm: Arm, total: int) -> Array:
    """Joints within their limits as the file will show them, shape (total, n), rad or m."""
    low, high = arm.limits.T
    if rng.random() < 0.5:
        unit = rng.random((total, arm.dof))
    else:
        unit = qmc.Sobol(arm.dof, scramble=True, rng=rng).random(1 << (total - 1).bit_length())
        unit = unit[rng.permutation(len(unit))[:total]]
    joints = low + unit * (high - low)
    # Rounded as the file will show them (1e-6 deg, 1e-6 mm), so that file and truth agree.
    unit_of = np.where(arm.slides, 1e-3, np.pi / 180.0)
    rounded: Array = np.round(joints / unit_of, 6) * unit_of
    return rounded


def in_any_order(rng: np.random.Generator, visits: NDArray[np.int_]) -> NDArray[np.int_]:
    """Visits in an order in which none follows itself."""
    while True:
        order = rng.permutation(visits)
        if np.all(np.diff(order)):
            return order


def draw_temperature(rng: np.random.Generator, time: Array) -> Array:
    """Up and down within the session: heat must not look like time."""
    phase = 2.0 * np.pi * (rng.uniform(1.2, 2.6) * time / time[-1] + rng.random())
    swing, ramp = rng.uniform(2.0, 4.0), rng.uniform(-1.5, 1.5)
    value = rng.uniform(19.0, 24.0) + swing * np.sin(phase) + ramp * time / time[-1]
    shown: Array = np.round(value, 3)
    return shown


def approaches(rng: np.random.Generator, q: Array, known_start: bool) -> tuple[Array, Array]:
    """Sign of each joint's last motion and size of the move before each reading, shape (N, n)."""
    first = rng.choice([-1.0, 1.0], q.shape[1]) if known_start else np.zeros(q.shape[1])
    approach = np.zeros_like(q)
    motion = np.zeros_like(q)
    approach[0] = first
    for i in range(1, len(q)):
        step = q[i] - q[i - 1]
        moved = np.abs(step) > 1e-7
        approach[i] = np.where(moved, np.sign(step), approach[i - 1])
        motion[i] = np.where(moved, np.abs(step), motion[i - 1])
    return approach, motion


READINGS = {"once": 1, "free and loaded": 2, "thrice": 3}
"""Readings of one visit: thrice without a move between them, which shows the instrument alone."""
READING_S = 45.0
_REVISITED = 4
_GRID_DEG = (5.0, 10.0, 15.0)


def draw_day(
    rng: np.random.Generator,
    arm: Arm,
    visit: str,
    configurations: int,
    held_out: int,
    *,
    timed: bool,
    known_start: bool,
    grid: bool,
) -> Session:
    """Readings of all configurations, some of which are visited three times.

    visit : of ``READINGS``; grid : one joint stands at equal steps
    timed : the hold-out lies between the others, else it follows them after a rest. The pace is even
        then, so that the order of the rows is a clock
    known_start : the file tells the approach of the first reading
    """
    total = configurations + held_out
    joints = draw_configurations(rng, arm, total)
    if grid:
        joints = _on_a_grid(rng, arm, joints)
    again = () if visit == "thrice" else np.repeat(np.arange(_REVISITED), 2)
    visits = _visits(
        rng, np.concatenate([np.arange(total), again]).astype(int), configurations, timed
    )
    per = READINGS[visit]
    config = np.repeat(visits, per)
    loaded = np.repeat(rng.random(len(visits)) < 0.5, per)
    if visit == "free and loaded":
        loaded = np.tile([False, True], len(visits))
    N = len(config)
    paces = rng.uniform(30.0, 60.0, N) if timed else np.full(N, READING_S)
    time, held = np.cumsum(paces).round(1), config >= configurations
    made = _session(rng, arm, joints, config, held, loaded, time, known_start)
    return made if timed else replace(made, pause=int(np.argmax(held)))


def _visits(
    rng: np.random.Generator, visits: NDArray[np.int_], configurations: int, timed: bool
) -> NDArray[np.int_]:
    """An order that begins with a pose that is fitted: there the clocks of all begin."""
    while True:
        order = in_any_order(rng, visits)
        if not timed:
            order = order[np.argsort(order >= configurations, kind="stable")]
        if order[0] < configurations and np.all(np.diff(order)):
            return order


def _on_a_grid(rng: np.random.Generator, arm: Arm, joints: Array) -> Array:
    """The same with one turning joint at whole multiples of some degrees."""
    k = int(rng.choice(np.flatnonzero(~arm.slides)))
    step = float(rng.choice(_GRID_DEG))
    low, high = np.degrees(arm.limits[k])
    steps = np.clip(
        np.round(np.degrees(joints[:, k]) / step), np.ceil(low / step), np.floor(high / step)
    )
    found = joints.copy()
    found[:, k] = np.radians(steps * step)
    return found
