"""How the tip moves with each parameter of the arm.

Derivatives are velocity fields: a parameter that displaces frame k moves all beyond it by
``A + phi x x``, and through the loads it also changes the deflection of every elastic frame
(:mod:`calib.coupling`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from calib.coupling import coupled
from calib.effects.protocol import (
    Constant,
    Effect,
    LoadEffect,
    SpringEffect,
    State,
    TwistEffect,
    WeightEffect,
)
from calib.kinematics import link_origins, spatial_columns
from calib.robot import Robot
from calib.se3 import Array
from calib.statics import Loads, transmitted


def arm_columns(
    robot: Robot,
    effects: Sequence[Effect],
    state: State,
    given: Loads,
    loads: Loads,
    elastic: Mapping[int, Array],
) -> Array:
    """Velocity field of the tip for each parameter that moves the arm, (..., m, 6, k), base axes.

    given, loads : Loads, without and with the errors of weights and wrenches
    elastic : dict, frame -> ndarray, shape (..., m, 6, 6), flexibility
    The k columns are the parameters of the twist and load effects, in their order. One that displaces
    several frames has a column at each of them, and these are added in the end.
    """
    fields: list[Array] = []
    wrenches: list[Array] = []
    acts_at: list[int] = []
    owners: list[int] = []
    count = 0
    for effect in effects:
        if not isinstance(effect, TwistEffect | LoadEffect):
            continue
        own = range(count, count + len(effect.parameters))
        for frame, moved, wrench in _motions(robot, effect, state, given):
            fields.append(moved)
            wrenches.append(wrench)
            acts_at += [frame] * len(own)
            owners += own
        count += len(own)
    columns = _joined(fields)
    if elastic:
        columns = coupled(
            columns,
            np.array(acts_at),
            _joined(wrenches),
            elastic,
            loads,
            state.frames,
            state.wrench,
        )
    if len(owners) == count:
        return columns
    return np.asarray(columns @ np.eye(count)[owners])


def _motions(
    robot: Robot, effect: Effect, state: State, given: Loads
) -> Iterator[tuple[int, Array, Array]]:
    """Frames on which an effect acts, with velocity fields (.., m, 6, p) and wrenches on all frames
    (.., m, n + 2, 6, p), in their axes.
    """
    m, p, frames = len(state.poses), len(effect.parameters), state.frames
    if isinstance(effect, TwistEffect):
        stage = frames.constant if isinstance(effect, Constant) else frames.present
        for frame, basis in effect.strands(state):
            moved = np.swapaxes(spatial_columns(stage, frame, basis), -1, -2)
            yield frame, moved, np.zeros((m, robot.dof + 2, 6, p))
    elif isinstance(effect, SpringEffect):
        yield robot.tip_frame, np.zeros((m, 6, p)), effect.wrench_basis(state.poses)
    elif isinstance(effect, WeightEffect):
        carriers = link_origins(robot, frames, state.poses.q)
        changes = effect.changes(state.poses, given)
        local = [transmitted(change, frames, carriers).local for change in changes]
        yield robot.tip_frame, np.zeros((m, 6, p)), np.stack(local, axis=-1)


def _joined(blocks: list[Array]) -> Array:
    """Columns side by side; leading axes that only some of them have are repeated."""
    batch = np.broadcast_shapes(*(block.shape[:-1] for block in blocks))
    return np.concatenate([np.broadcast_to(b, (*batch, b.shape[-1])) for b in blocks], axis=-1)
