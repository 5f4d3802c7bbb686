"""Static equilibrium of an arm in MuJoCo, which has the kinematics and the internal forces."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.truth.arms import Arm, Array

G = 9.80665  # m/s^2, along -z of the base
_AT_REST, _ROUNDS = 1e-11, 25  # m, largest motion of a marker between the last two rounds


@dataclass(frozen=True, eq=False)
class State:
    """The arm at rest under its loads, as MuJoCo gives it, N readings, frames 0 .. n + 1.

    R, o : ndarray, shapes (N, n + 2, 3, 3) and (N, n + 2, 3), frames before joint motion, base axes, m
    R_link : ndarray, shape (N, n + 2, 3, 3), after joint motion
    wrench : ndarray, shape (N, n + 2, 6), force and moment that each frame passes on, about its origin,
        in its axes, N and N m
    torque : ndarray, shape (N, n), N m, or N at a prismatic joint
    points : ndarray, shape (N, M, 3), markers, base axes, m
    aimed, readings : ndarray, shape (N, M, 3), the same in the instrument's frame, and as it is read
    """

    R: Array
    o: Array
    R_link: Array
    wrench: Array
    torque: Array
    points: Array
    aimed: Array
    readings: Array


@dataclass(frozen=True, eq=False)
class Action:
    """Displacements and loads at N readings; actions add up.

    joint : ndarray, shape (N, n), ``q_true = q_read + joint``, rad or m
    twist : ndarray, shape (N, n + 2, 6), displacement of each frame on the right, m and rad
    load : ndarray, shape (N, n + 2, 6), force and torque at the centre of mass of each body, base axes
    marker : ndarray, shape (N, M, 3), of the markers in the tip frame, m
    reading : ndarray, shape (N, M, 3), in the instrument's frame, m
    """

    joint: Array
    twist: Array
    load: Array
    marker: Array
    reading: Array

    @staticmethod
    def none(arm: Arm, count: int, markers: int) -> Action:
        """Nothing yet: arrays to write into."""
        frames, points = (count, arm.dof + 2, 6), (count, markers, 3)
        return Action(*map(np.zeros, ((count, arm.dof), frames, frames, points, points)))

    def add(self, other: Action, factor: Array) -> None:
        """Add another one, reading by reading times a factor, shape (N,)."""
        for field in fields(self):
            more = getattr(other, field.name)
            mine = getattr(self, field.name)
            mine += more * factor.reshape(-1, *(1,) * (more.ndim - 1))


def frame_columns(state: State, frame: int) -> Array:
    """D points / d twist of a frame, shape (N, M, 3, 6), base axes: what follows it moves rigidly."""
    R, lever = state.R[:, None, frame], state.points - state.o[:, None, frame]
    columns = np.empty((*state.points.shape, 6))
    columns[..., :3] = R
    for c in range(3):
        columns[..., 3 + c] = np.cross(R[..., c], lever)
    return columns


class Mechanism:
    """One arm with its true geometry, ready to be posed.

    geometry : ndarray, shape (n + 2, 6), displacement of each frame, m and rad
    markers : ndarray, shape (M, 3), true positions in the tip frame, m
    weighs : whether the links have their weight
    """

    def __init__(self, arm: Arm, geometry: Array, markers: Array, weighs: bool = True) -> None:
        self.arm, self.markers = arm, markers
        # Loaded here, so that scoring needs no simulator. It comes with the extra "sim".
        self._mujoco: Any = importlib.import_module("mujoco")
        self.model: Any = self._mujoco.MjModel.from_xml_string(mjcf(arm, geometry, markers))
        if not weighs:
            self.model.body_mass[:] = 0.0
        self.data: Any = self._mujoco.MjData(self.model)
        self._pos, self._site = self.model.body_pos[1:].copy(), self.model.site_pos.copy()
        quaternions = np.roll(self.model.body_quat[1:], -1, axis=1)  # w first there
        self._turn = Rotation.from_quat(quaternions)

    def rest(
        self, q: Array, act: Callable[[State], Action], instrument: tuple[Array, Array]
    ) -> State:
        """Equilibrium under what ``act`` does in each state, found by iteration.

        q : ndarray, shape (N, n), as read; instrument : R (3, 3) and p (3,) of instrument from base
        """
        state = self._pose(q, self._nothing(q), instrument)
        for _ in range(_ROUNDS):
            new = self._pose(q, act(state), instrument)
            moved = np.abs(new.points - state.points).max(initial=0.0)
            loaded = np.abs(new.torque - state.torque).max(initial=0.0)
            state = new
            if moved < _AT_REST and loaded < 1e-7:
                return state
        raise RuntimeError("the arm does not come to rest: it is too soft for its loads")

    def posed(self, q: Array) -> State:
        """The arm with joints as read and nothing acting but its weight."""
        return self._pose(q, self._nothing(q), (np.eye(3), np.zeros(3)))

    def _nothing(self, q: Array) -> Action:
        return Action.none(self.arm, len(q), len(self.markers))

    def _pose(self, q: Array, action: Action, instrument: tuple[Array, Array]) -> State:
        N, frames, n = len(q), self.arm.dof + 2, self.arm.dof
        mujoco, model, data = self._mujoco, self.model, self.data
        turn = Rotation.from_rotvec(action.twist[..., 3:].reshape(-1, 3))
        relative = Rotation.concatenate([self._turn] * N) * turn
        pos = self._pos + np.einsum("fij,nfj->nfi", self._turn.as_matrix(), action.twist[..., :3])
        quat = np.roll(relative.as_quat(), 1, axis=1).reshape(N, frames, 4)
        qpos, sites = q + action.joint, self._site + action.marker
        xpos, xmat = np.empty((N, frames, 3)), np.empty((N, frames, 9))
        inner, centre = np.empty((N, frames, 6)), np.empty((N, 1, 3))
        points = np.empty((N, len(self.markers), 3))
        for i in range(N):
            model.body_pos[1:], model.body_quat[1:] = pos[i], quat[i]
            model.site_pos[:], data.qpos[:] = sites[i], qpos[i]
            data.xfrc_applied[1:] = action.load[i]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_rnePostConstraint(model, data)
            xpos[i], xmat[i], points[i] = data.xpos[1:], data.xmat[1:], data.site_xpos
            inner[i], centre[i] = data.cfrc_int[1:], data.subtree_com[1]
        R_link = xmat.reshape(N, frames, 3, 3)
        R, o = relative.as_matrix().reshape(N, frames, 3, 3), pos.copy()
        R[:, 1:] = R_link[:, :-1] @ R[:, 1:]
        o[:, 1:] = xpos[:, :-1] + np.einsum("nfij,nfj->nfi", R_link[:, :-1], pos[:, 1:])
        # cfrc_int is what the link before a body holds it with, (moment, force) about the centre of
        # mass of the whole arm; what the body passes on is the opposite.
        force = -inner[..., 3:]
        moment = -inner[..., :3] + np.cross(centre - o, force)
        axes = np.swapaxes(R, -1, -2)
        wrench = np.concatenate([(axes @ v[..., None])[..., 0] for v in (force, moment)], axis=-1)
        at = wrench[:, 1 : n + 1]
        along = np.where(self.arm.slides[:, None], at[..., :3], at[..., 3:])
        torque = np.einsum("nki,ki->nk", along, self.arm.axes)
        aimed = points @ instrument[0].T + instrument[1]
        return State(R, o, R_link, wrench, torque, points, aimed, aimed + action.reading)


def urdf(arm: Arm, masses: bool = True) -> str:
    """The nominal robot; without masses where the user does not know them."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{arm.name}">', f'  <link name="{arm.base}"/>']
    parent = arm.base
    for index, joint in enumerate(arm.joints, 1):
        child, kind = f"link_{index}", "prismatic" if joint.slides else "revolute"
        lines.append(
            f'  <joint name="{joint.name}" type="{kind}">{_origin(joint.xyz, joint.rpy)}'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{_text(joint.axis)}"/>'
            f'<limit lower="{joint.low:.9g}" upper="{joint.high:.9g}" effort="0" velocity="0"/></joint>'
        )
        inertial = (
            f'<inertial>{_origin(joint.com)}<mass value="{joint.mass:.9g}"/>'
            '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
        )
        lines.append(f'  <link name="{child}">{inertial if masses else ""}</link>')
        parent = child
    lines.append(
        f'  <joint name="mount" type="fixed">{_origin(arm.tip_xyz, arm.tip_rpy)}'
        f'<parent link="{parent}"/><child link="{arm.tip}"/></joint>'
    )
    return "\n".join([*lines, f'  <link name="{arm.tip}"/>', "</robot>", ""])


def mjcf(arm: Arm, geometry: Array, markers: Array) -> str:
    """The arm with displaced joint frames: bodies base, one a link, tip; one site a marker."""
    lines = [
        '<mujoco><compiler angle="radian" fusestatic="false"/>',
        f'<option gravity="0 0 {-G}"/><worldbody>',
        f'<body name="frame_0" {_placed((0, 0, 0), (0, 0, 0), geometry[0])}>',
    ]
    for index, joint in enumerate(arm.joints, 1):
        lines.append(
            f'<body name="frame_{index}" {_placed(joint.xyz, joint.rpy, geometry[index])}>'
            f'<joint type="{"slide" if joint.slides else "hinge"}" axis="{_text(joint.axis)}"/>'
            # The inertia turns nothing here: the arm stands still.
            f'<inertial pos="{_text(joint.com)}" mass="{joint.mass!r}" diaginertia="1 1 1"/>'
        )
    lines.append(
        f'<body name="tip" {_placed(arm.tip_xyz, arm.tip_rpy, geometry[-1])}>'
        # Loads act at a body's centre of mass: a nanogram puts that at the tip's origin.
        '<inertial pos="0 0 0" mass="1e-12" diaginertia="1 1 1"/>'
    )
    lines += [f'<site name="m{i}" pos="{_text(m)}"/>' for i, m in enumerate(markers, 1)]
    return "\n".join([*lines, "</body>" * (arm.dof + 2), "</worldbody></mujoco>"])


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def _origin(xyz: Sequence[float], rpy: Sequence[float] = (0, 0, 0)) -> str:
    at, turn = (" ".join(f"{v:.9g}" for v in values) for values in (xyz, rpy))
    return f'<origin xyz="{at}" rpy="{turn}"/>'


def _placed(xyz: Sequence[float], rpy: Sequence[float], displaced: Array) -> str:
    turn = Rotation.from_euler("xyz", rpy)
    at = np.asarray(xyz) + turn.apply(displaced[:3])
    x, y, z, w = (turn * Rotation.from_rotvec(displaced[3:])).as_quat()
    return f'pos="{_text(at)}" quat="{_text((w, x, y, z))}"'
