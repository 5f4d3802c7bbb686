"""Static equilibrium of an arm in MuJoCo: kinematics and internal forces are its own."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.withheld.actions import Action, State
from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.texts import mjcf

_AT_REST = 1e-11  # m, largest motion of a marker between the last two rounds
_ROUNDS = 25

Act = Callable[[State], Action]


class Mechanism:
    """One arm with its true geometry, ready to be posed.

    arm : Arm
    geometry : ndarray, shape (n + 2, 6), displacement of each frame, m and rad
    markers : ndarray, shape (M, 3), true positions in the tip frame, m
    weighs : whether the links have their weight
    """

    def __init__(self, arm: Arm, geometry: Array, markers: Array, weighs: bool = True) -> None:
        self.arm = arm
        self.markers = markers
        # Loaded here, so that scoring needs no simulator. It comes with the extra "sim".
        self._mujoco: Any = importlib.import_module("mujoco")
        self.model: Any = self._mujoco.MjModel.from_xml_string(mjcf(arm, geometry, markers))
        if not weighs:
            self.model.body_mass[:] = 0.0
        self.data: Any = self._mujoco.MjData(self.model)
        self._pos = self.model.body_pos[1:].copy()
        self._quat = Rotation.from_quat(
            np.roll(self.model.body_quat[1:], -1, axis=1)
        )  # w first there
        self._site = self.model.site_pos.copy()

    def rest(self, q: Array, act: Act, instrument: tuple[Array, Array]) -> State:
        """Equilibrium under what ``act`` does in each state, found by iteration.

        q : ndarray, shape (N, n), as read; instrument : R (3, 3) and p (3,) of instrument from base
        """
        nothing = Action.none(self.arm, len(q), len(self.markers))
        state = self._pose(q, nothing, instrument)
        for _ in range(_ROUNDS):
            action = act(state)
            new = self._pose(q, action, instrument)
            moved = np.abs(new.points - state.points).max(initial=0.0)
            loaded = np.abs(new.torque - state.torque).max(initial=0.0)
            state = new
            if moved < _AT_REST and loaded < 1e-7:
                return state
        raise RuntimeError("the arm does not come to rest: it is too soft for its loads")

    def posed(self, q: Array) -> State:
        """The arm with joints as read and nothing acting but its own weight."""
        nothing = Action.none(self.arm, len(q), len(self.markers))
        return self._pose(q, nothing, (np.eye(3), np.zeros(3)))

    def _pose(self, q: Array, action: Action, instrument: tuple[Array, Array]) -> State:
        N, frames, n = len(q), self.arm.dof + 2, self.arm.dof
        mujoco, model, data = self._mujoco, self.model, self.data
        turn = Rotation.from_rotvec(action.twist[..., 3:].reshape(-1, 3))
        base = Rotation.concatenate([self._quat] * N)
        R_nominal = self._quat.as_matrix()
        pos = self._pos + np.einsum("fij,nfj->nfi", R_nominal, action.twist[..., :3])
        relative = base * turn
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
            xpos[i], xmat[i] = data.xpos[1:], data.xmat[1:]
            inner[i], centre[i] = data.cfrc_int[1:], data.subtree_com[1]
            points[i] = data.site_xpos
        R_link = xmat.reshape(N, frames, 3, 3)
        R = relative.as_matrix().reshape(N, frames, 3, 3)
        R[:, 1:] = R_link[:, :-1] @ R[:, 1:]
        o = pos.copy()
        o[:, 1:] = xpos[:, :-1] + np.einsum("nfij,nfj->nfi", R_link[:, :-1], pos[:, 1:])
        # cfrc_int is what the link before a body holds it with, (moment, force) about the centre of
        # mass of the whole arm; what the body passes on is the opposite.
        force = -inner[..., 3:]
        moment = -inner[..., :3] + np.cross(centre - o, force)
        axes = np.swapaxes(R, -1, -2)
        wrench = np.concatenate(
            [(axes @ force[..., None])[..., 0], (axes @ moment[..., None])[..., 0]], axis=-1
        )
        own = np.where(self.arm.slides[:, None], wrench[:, 1 : n + 1, :3], wrench[:, 1 : n + 1, 3:])
        torque = np.einsum("nki,ki->nk", own, self.arm.axes)
        R_in, p_in = instrument
        aimed = points @ R_in.T + p_in
        return State(R, o, R_link, wrench, torque, points, aimed, aimed + action.reading)
