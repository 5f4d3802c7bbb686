"""The truth from MuJoCo: its own kinematics, its own torques, and the arm at rest under them.

Nothing of the model that is compared enters but what the parameters mean: of kinematics, statics and
their derivatives no line is shared, so that a wrong torque, weight or sign cannot cancel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.effects import Effect
from calib.effects.base import Base
from calib.effects.compliance import JointCompliance
from calib.effects.geometry import JointOffset
from calib.effects.last_move import Backlash
from calib.effects.mass import LinkWeight, PayloadError
from calib.effects.protocol import ConstantTwist
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.effects.tool import Tool
from calib.effects.transmission import JointCoupling, TransmissionHarmonic, TransmissionScale
from calib.errors import CalibError, InputError
from calib.files.mjcf import mujoco_for
from calib.instruments import Tracker
from calib.model import Model
from calib.poses import Poses

_AT_REST = 1e-12  # rad or m, largest motion of a joint between the last two rounds
_ROUNDS = 200
_NOTHING = 1e-9  # kg: MuJoCo moves no body without mass


@dataclass(frozen=True, eq=False)
class _Truth:
    """What the values mean, in the terms of a mechanism.

    frames : ndarray, shape (n + 2, 6), m and rad, constant displacement of each frame
    dq : ndarray, shape (m, n), rad or m, errors of the joints' readings
    compliance : ndarray, shape (m, n), rad/(N m) or m/N
    masses : ndarray, shape (n,), kg; payload : float, kg; com : ndarray, shape (3,), m, tip frame
    markers : ndarray, shape (M, 3), m, tip frame
    bases : dict, station -> (x, y, z, rx, ry, rz), m and rad
    """

    frames: Array
    dq: Array
    compliance: Array
    masses: Array
    payload: float
    com: Array
    markers: Array
    bases: dict[int, Array]


def points_in_mujoco(cell: Cell, model: Model, values: Array, poses: Poses) -> Array:
    """Readings without noise, shape (m, M, 3), m, in the frames of the stations.

    values : ndarray, shape (p,), SI

    Raises InputError where MuJoCo is not installed or has nothing like this cell, CalibError for an arm
    that finds no rest.
    """
    from scipy.spatial.transform import Rotation

    for number, own in enumerate(cell.instruments):
        if number or type(own) is not Tracker:
            raise _unlike(f"instrument {own.name} ({own.kind})")
    if model.robot.branched:
        raise _unlike(f"a robot with the tips {', '.join(model.robot.tips)}")
    truth = _meaning(model, values, poses)
    with mujoco_for(cell.path) as mujoco:
        arm: Any = mujoco.MjModel.from_xml_string(_mjcf(model, truth))
        points = np.stack([_rest(mujoco, arm, truth, poses, i) for i in range(len(poses))])
    for station, placed in truth.bases.items():
        here = poses.station == station
        turn = Rotation.from_rotvec(placed[3:]).as_matrix()
        points[here] = points[here] @ turn.T + placed[:3]
    return points


def _meaning(model: Model, values: Array, poses: Poses) -> _Truth:
    """Read the values effect by effect, by what the file formats say of them."""
    robot, q = model.robot, poses.q
    frames, dq = np.zeros((robot.dof + 2, 6)), np.zeros(q.shape)
    compliance, masses, markers = np.zeros(q.shape), robot.masses.copy(), model.markers.copy()
    payload, com, bases = model.payload.mass, np.array(model.payload.com), {}
    for effect, part in model.parts:
        own = values[part]
        joint = robot.joints.index(effect.where) if effect.where in robot.joints else -1
        match effect:
            case Base():
                bases[effect.station or 0] = own
            case Tool():
                markers[effect.marker, list(effect.components)] += own
            case ConstantTwist():
                frames[effect.frame, list(effect.components)] += own
            case JointCompliance():
                compliance[:, joint] += own[0]
            case StiffnessVsAngle():
                compliance[:, joint] += np.interp(q[:, joint], effect.knots, own)
            case LinkWeight():
                masses[joint] += own[0]
            case PayloadError() if not effect.measured:
                heavier = payload + own[0]
                if len(own) > 1:  # a shift of the mass as given
                    com = com + payload / heavier * own[1:]
                payload = heavier
            case _:
                dq[:, joint] += _joint_error(effect, own, joint, poses)
    return _Truth(frames, dq, compliance, masses, payload, com, markers, bases)


def _joint_error(effect: Effect, own: Array, joint: int, poses: Poses) -> Array:
    """Error of one joint's reading at each pose, shape (m,), rad or m."""
    q = poses.q[:, joint]
    match effect:
        case JointOffset():
            return np.full(len(q), own[0])
        case TransmissionScale():
            return np.asarray(own[0] * q)
        case TransmissionHarmonic():
            return np.asarray(
                own[0] * np.cos(q) + own[1] * np.sin(q)
                + own[2] * np.cos(2 * q) + own[3] * np.sin(2 * q)
            )  # fmt: skip
        case JointCoupling():
            return np.asarray(np.delete(poses.q, joint, axis=1) @ own)
        case Backlash() if poses.approach is not None:
            return np.asarray(own[0] * poses.approach[:, joint])
    raise _unlike(f"{effect.kind}:{effect.where}")


def _unlike(what: str) -> InputError:
    says = f"{what} is nothing that MuJoCo's model of an arm has"
    remedy = "take it out of the cell, or leave out --truth mujoco"
    return InputError("--truth", "mujoco", says, remedy)


def _rest(mujoco: Any, arm: Any, truth: _Truth, poses: Poses, i: int) -> Array:
    """The markers in base axes, shape (M, 3), m, once the joints have yielded to their torques."""
    data = mujoco.MjData(arm)
    q = poses.q[i] + truth.dq[i]
    present = q
    for _ in range(_ROUNDS):
        data.qpos[:] = present
        mujoco.mj_forward(arm, data)
        yielded = q + truth.compliance[i] * _torques(mujoco, arm, data, poses, i)
        moved = float(np.abs(yielded - present).max(initial=0.0))
        present = yielded
        if moved < _AT_REST:
            return np.array(data.site_xpos)
    raise CalibError(f"pose {poses.names[i]}: the arm is too soft to come to rest under its load")


def _torques(mujoco: Any, arm: Any, data: Any, poses: Poses, i: int) -> Array:
    """Torque or force on each joint along its motion, shape (n,): weights, wrench, hung load."""
    tip = arm.nbody - 1
    pushed = np.zeros(arm.nv)
    origin, turn = data.xpos[tip], data.xmat[tip].reshape(3, 3)
    wrench = poses.wrench[i]
    mujoco.mj_applyFT(arm, data, wrench[:3], wrench[3:], origin, tip, pushed)
    hung, at = poses.load_mass[i] * arm.opt.gravity, origin + turn @ poses.load_com
    mujoco.mj_applyFT(arm, data, hung, np.zeros(3), at, tip, pushed)
    return np.asarray(pushed - data.qfrc_bias)


def _mjcf(model: Model, truth: _Truth) -> str:
    """The arm as bodies base, one a link, and tip; one site a marker."""
    robot = model.robot
    return "".join(
        [
            '<mujoco><compiler angle="radian" fusestatic="false"/>',
            f'<option gravity="{_words(model.gravity)}"/><worldbody>',
            f"<body {_placed(np.eye(4), truth.frames[0])}>",
            *_links(model, truth),
            f"<body {_placed(robot.origins[-1], truth.frames[-1])}>",
            _inertial(truth.payload, truth.com),
            *(f'<site pos="{_words(marker)}"/>' for marker in truth.markers),
            "</body>" * (robot.dof + 2),
            "</worldbody></mujoco>",
        ]
    )


def _links(model: Model, truth: _Truth) -> Iterator[str]:
    robot = model.robot
    for k, slides in enumerate(robot.prismatic):
        kind = "slide" if slides else "hinge"
        yield f"<body {_placed(robot.origins[k], truth.frames[k + 1])}>"
        yield f'<joint type="{kind}" axis="{_words(robot.axes[k])}"/>'
        yield _inertial(truth.masses[k], robot.coms[k])


def _inertial(mass: float, com: Array) -> str:
    """The inertia of a body that stands still: any will do."""
    return f'<inertial pos="{_words(com)}" mass="{_words([max(mass, _NOTHING)])}" diaginertia="1 1 1"/>'


def _placed(T: Array, xi: Array) -> str:
    """A frame displaced in its own axes: shifted, then turned."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(T[:3, :3])
    x, y, z, w = (turn * Rotation.from_rotvec(xi[3:])).as_quat()
    return f'pos="{_words(T[:3, 3] + turn.apply(xi[:3]))}" quat="{_words((w, x, y, z))}"'


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
