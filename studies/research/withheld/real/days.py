"""The day of a real arm: one, two or three readings a visit, with and without a clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.session import (
    Session,
    approaches,
    draw_configurations,
    draw_temperature,
    in_any_order,
)

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
    time: Array = np.cumsum(paces).round(1)
    force = np.zeros((N, 3))
    force[loaded, 2] = -arm.load
    approach, motion = approaches(rng, joints[config], known_start)
    return Session(
        names=tuple(
            f"p{c:03d}_{'loaded' if load else 'free'}_{i:03d}"
            for i, (c, load) in enumerate(zip(config, loaded, strict=True))
        ),
        q=joints[config],
        held=config >= configurations,
        force=force,
        hang=np.round(rng.uniform(-0.6, 0.6, 3) * arm.tool, 4),
        time=time,
        temperature=draw_temperature(rng, time),
        approach=approach,
        motion=motion,
        pause=None if timed else int(np.argmax(config >= configurations)),
    )


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
