"""How tips move with each parameter of the arm.

Derivatives are velocity fields: a parameter that displaces frame k moves all that it carries by
``A + phi x x``, and through the loads it also changes the deflection of every elastic frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from calib.arm.kinematics import Frames, link_origins, spatial_columns
from calib.arm.robot import Robot
from calib.arm.se3 import cross
from calib.arm.statics import Loads, Transmitted, change_beyond, transmitted
from calib.arrays import Array, IntArray
from calib.effects.loads import SpringEffect
from calib.effects.protocol import (
    Constant,
    Effect,
    LoadEffect,
    State,
    TwistEffect,
    WeightEffect,
)


def arm_jacobian(
    robot: Robot,
    parts: Sequence[tuple[Effect, slice]],
    values: Array,
    state: State,
    given: Loads,
    loads: Loads,
    elastic: Mapping[tuple[int, int], Array],
    tips: Sequence[int],
) -> list[Array]:
    """Velocity field of each tip for each parameter, shape (..., m, 6, p), base axes.

    parts : each effect and where its parameters stand in the values
    values : ndarray, shape (..., p), SI
    given, loads : Loads, without and with the errors of weights and wrenches
    elastic : dict, (frame, felt at) -> ndarray, shape (..., m, 6, 6), flexibility
    tips : frames of the tips
    Columns of what does not move a tip are zero. A parameter that displaces several frames gets the
    sum of what it does at each.
    """
    at: dict[tuple[int, bool], list[tuple[slice, Array]]] = {}
    pulls: list[tuple[slice, Array]] = []
    for effect, part in parts:
        if isinstance(effect, TwistEffect):
            for frame, basis in effect.twists(state, values[..., part]):
                at.setdefault((frame, isinstance(effect, Constant)), []).append((part, basis))
        elif isinstance(effect, LoadEffect):
            pulls.append((part, _wrenches(robot, effect, state, given)))
    acts_at = [frame for frame, _ in at]
    moves = [
        _fields(state, frame, fixed, _joined([basis for _, basis in twists]))
        for (frame, fixed), twists in at.items()
    ]
    m = len(state.poses)
    wrench = _joined([w for _, w in pulls]) if pulls else np.zeros((m, robot.frame_count, 6, 0))
    pulled = np.zeros((m, 6, wrench.shape[-1]))
    answers = (
        _with_deflection(robot, moves, acts_at, pulled, wrench, elastic, loads, state, tips)
        if elastic
        else [(*_carried(robot, moves, acts_at, tip), pulled) for tip in tips]
    )
    return [_columns(answer, (*at.values(), pulls), values) for answer in answers]


def _carried(
    robot: Robot, moves: Sequence[Array], acts_at: Sequence[int], tip: int
) -> Iterator[Array]:
    """The fields as a tip feels them: nothing of frames that do not carry it."""
    for moved, frame in zip(moves, acts_at, strict=True):
        yield moved if robot.carries[frame, tip] else np.zeros_like(moved)


def _columns(
    fields: Sequence[Array], acting: Sequence[Sequence[tuple[slice, Array]]], values: Array
) -> Array:
    """Fields of a tip put where the parameters stand that cause them, shape (..., m, 6, p)."""
    batch = np.broadcast_shapes(*(moved.shape[:-1] for moved in fields))
    columns = np.zeros((*batch, values.shape[-1]))
    for moved, twists in zip(fields, acting, strict=True):
        begin = 0
        for own, basis in twists:
            end = begin + basis.shape[-1]
            columns[..., own] += moved[..., begin:end]
            begin = end
    return columns


def _fields(state: State, frame: int, fixed: bool, basis: Array) -> Array:
    """Velocity fields (..., m, 6, p) of twists (..., m, 6, p) of one frame.

    fixed : whether they act before what depends on the pose
    """
    stage = state.frames.constant if fixed else state.frames.present
    return spatial_columns(stage, frame, basis)


def _wrenches(robot: Robot, effect: Effect, state: State, given: Loads) -> Array:
    """What a load effect adds to all frames, shape (..., m, F, 6, p), in their axes."""
    if isinstance(effect, SpringEffect):
        return effect.wrench_basis(state.poses, robot.frame_count)
    if not isinstance(effect, WeightEffect):
        raise TypeError(f"{effect.kind} is neither a spring nor a weight")
    carriers = link_origins(robot, state.frames, state.poses.q)
    changes = effect.changes(state.poses, given)
    local = [transmitted(robot, change, state.frames, carriers).local for change in changes]
    return np.stack(local, axis=-1)


def _with_deflection(
    robot: Robot,
    moves: Sequence[Array],
    acts_at: Sequence[int],
    pulled: Array,
    wrench: Array,
    elastic: Mapping[tuple[int, int], Array],
    loads: Loads,
    state: State,
    tips: Sequence[int],
) -> list[list[Array]]:
    """The same fields with the deflections that they cause, for each tip.

    The arm answers linearly: where a frame has many columns, its answer to the six unit motions does
    for all of them.
    """
    unit = np.broadcast_to(np.eye(6), (len(state.poses), 6, 6))
    shown = [moved if moved.shape[-1] <= 6 else unit for moved in moves]
    counts = [own.shape[-1] for own in (*shown, pulled)]
    own = _joined([*shown, pulled])
    none = np.zeros((*wrench.shape[:-1], own.shape[-1] - wrench.shape[-1]))
    loaded = _joined([none, wrench])
    frames = np.repeat([*acts_at, robot.tip_frame], counts)
    answers = coupled(robot, own, frames, loaded, elastic, loads, state.frames, state.wrench, tips)
    found = []
    for answer in answers:
        *parts, rest = np.split(answer, np.cumsum(counts)[:-1], axis=-1)
        moved = [
            part if first.shape[-1] <= 6 else part @ first
            for part, first in zip(parts, moves, strict=True)
        ]
        found.append([*moved, rest])
    return found


def _joined(blocks: Sequence[Array]) -> Array:
    """Columns side by side; leading axes that only some of them have are repeated."""
    batch = np.broadcast_shapes(*(block.shape[:-1] for block in blocks))
    return np.concatenate([np.broadcast_to(b, (*batch, b.shape[-1])) for b in blocks], axis=-1)


# -- how a small motion anywhere in the arm changes the deflection everywhere else -------------------

# Moving a frame moves the loads, which changes the wrench at every elastic frame, which moves the loads
# again. With y_k the motion that elastic frame k adds and V_l the motion of frame l itself, both as
# velocity fields,
#
#     y_k = sum_j T_k K_kj
#           (whole_j sum_{l carries j} (V_l + y_l) + beyond sum_{j carries l} (V_l + y_l)) ,
#
# with j other than k where a drive moves several joints.
# Frames of another branch change nothing: their motion moves no load that frame k carries.
# Few components of a wrench bend a frame, of a joint's compliance the moment about its axis alone: how
# these change, at all elastic frames together, is what a small linear system is solved for, pose by
# pose.


def coupled(
    robot: Robot,
    own: Array,
    acts_at: IntArray,
    loaded: Array,
    elastic: Mapping[tuple[int, int], Array],
    loads: Loads,
    frames: Frames,
    wrench: Transmitted,
    tips: Sequence[int],
) -> list[Array]:
    """Motion of each tip for each parameter, the deflection that it causes included.

    own : ndarray, shape (..., m, 6, p), velocity field of each parameter's own displacement
    acts_at : ndarray of int, shape (p,), frame that each parameter displaces
    loaded : ndarray, shape (..., m, F, 6, p), wrench that each parameter adds to the frames
    elastic : dict, (frame, felt at) -> ndarray, shape (..., m, 6, 6), flexibility
    Returns ndarrays, shape (..., m, 6, p), base axes.
    """
    felt = {key: np.flatnonzero(K.any(axis=(*range(K.ndim - 2), -2))) for key, K in elastic.items()}
    strains = list(dict.fromkeys((j, c) for (_, j), own in felt.items() for c in own.tolist()))
    at, component = np.array(strains).T
    # What each component that is felt moves, of one frame or several.
    moving = np.repeat([k for k, _ in felt], [len(c) for c in felt.values()])
    by = [strains.index((j, c)) for (_, j), own in felt.items() for c in own.tolist()]
    alone = by == [*range(len(strains))]
    beyond = change_beyond(robot, loads, frames, wrench)
    axis = np.swapaxes(frames.R, -1, -2)[..., at, component % 3, :]
    near = _as_one(axis, component, beyond[..., at, :, 3:], frames.o[..., at, :], wrench, at)
    far = axis * (component >= 3)[:, None]

    def change(motion: Array, acts_at: IntArray) -> Array:
        carried = robot.carries[acts_at][:, at].T
        moments = far @ _moments(beyond, motion, acts_at)
        if robot.branched:
            moments = moments * robot.carries[np.ix_(at, acts_at)]
        return np.where(carried, near @ motion[..., 3:, :], moments)

    follow = np.concatenate(
        [spatial_columns(frames.present, k, elastic[k, j][..., c]) for (k, j), c in felt.items()],
        axis=-1,
    )
    given = change(own, acts_at) + loaded[..., at, component, :]
    answer = change(follow, moving)
    answer = answer if alone else answer @ np.eye(len(at))[by]
    strain = np.linalg.solve(np.eye(len(at)) - answer, given)
    strain = strain if alone else strain[..., by, :]

    def of(tip: int) -> Array:
        if not robot.branched:
            return np.asarray(own + follow @ strain)
        moved, bent = (robot.carries[frame, tip] for frame in (acts_at, moving))
        return np.asarray(own * moved + (follow * bent) @ strain)

    return [of(tip) for tip in tips]


def _as_one(
    axis: Array, component: IntArray, turn: Array, o: Array, wrench: Transmitted, at: IntArray
) -> Array:
    """How components of a frame's wrench follow its turning with all beyond it, (..., m, K, 3).

    axis : ndarray, shape (..., m, K, 3), base axes, of each component at its frame ``at``
    turn : ndarray, shape (..., m, K, 3, 3), what turning changes of the moment about a point that rests
    o : ndarray, shape (..., m, K, 3), m, origins of the frames
    The loads keep their direction while the axes turn; a shift changes nothing.
    """
    force = cross(axis, wrench.force[..., at, :])
    moment = np.einsum("...i,...ij->...j", axis, turn) - cross(force, o)
    moment = moment + cross(axis, wrench.moment[..., at, :])
    return np.ascontiguousarray(np.where((component >= 3)[:, None], moment, force))


def _moments(beyond: Array, motion: Array, acts_at: IntArray) -> Array:
    """Change of the moments by motions (..., m, 6, p) of all beyond the frames where they act."""
    batch = np.broadcast_shapes(beyond.shape[:-3], motion.shape[:-2])
    out = np.empty((*batch, 3, motion.shape[-1]))
    for frame in np.unique(acts_at):
        own = acts_at == frame
        out[..., own] = beyond[..., frame, :, :] @ motion[..., own]
    return out
