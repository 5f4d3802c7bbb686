"""With what the size of an effect might vary, if its shape is wrong: everything known of a reading.

Each modulation is a few functions of one variable with a root mean square of about one: two harmonics
of an angle, a straight line and a parabola of anything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.diagnosis.stage import Fit, Stage
from calib.effects.drive import along_axis
from calib.poses import Measurements, Poses

_STILL = 1e-6  # scatter, over size, of what does not vary
_OWN, _OTHERS, _KNOWN = 0.6, 0.15, 0.25
"""Shares of the chance of a false doubt: most errors of form run with the joint's own angle."""


@dataclass(frozen=True, eq=False)
class Modulation:
    """A few functions of a variable.

    depends_on : str, as in the results
    centred : ndarray, shape (m, k), about the mean: by what the size would vary
    plain : ndarray, shape (m, c), zero where the variable is: what the whole effect may run with
        instead; of an angle, which has no zero, none
    chance : float, share of the chance of a false doubt
    """

    depends_on: str
    centred: Array
    plain: Array
    chance: float


def modulations(stage: Stage, fit: Fit, where: str) -> list[Modulation]:
    """All that a table allows to ask of an effect at a place."""
    kept = ~stage.dropped
    found = list(_postures(fit.model.robot, stage.data.poses, kept, where))
    known = [
        (name, varying)
        for name, columns in _known(stage.data, fit, where)
        if (varying := [c for c in columns if _varies(c[kept])])
    ]
    for name, columns in known:
        powers = [c**n for c in columns for n in (1, 2)]
        centred = np.column_stack([_centred(p, kept) for p in powers if _varies(p[kept])])
        plain = np.column_stack([c / np.abs(c[kept]).max() for c in columns])
        found.append(Modulation(name, centred, plain, _KNOWN / len(known)))
    return found


def _postures(robot: Robot, poses: Poses, kept: Mask, where: str) -> Iterator[Modulation]:
    """Harmonics of once and twice each angle; of a slide, over its travel."""
    for k, joint in enumerate(robot.joints):
        if _varies(poses.q[kept, k]):
            run = waves(robot, poses.q, poses.q[kept], k)
            yield Modulation(
                f"q:{joint}", run, np.zeros((len(run), 0)), chance_of(robot, joint, where)
            )


def waves(robot: Robot, q: Array, over: Array, joint: int) -> Array:
    """Harmonics of a joint, of a slide those of its travel ``over`` some poses, shape (m, 4)."""
    angle = q[:, joint]
    if robot.prismatic[joint]:
        travel = over[:, joint]
        angle = np.pi * (angle - travel.mean()) / float(np.ptp(travel))
    return np.asarray(
        np.sqrt(2.0) * np.column_stack([f(n * angle) for n in (1, 2) for f in (np.cos, np.sin)])
    )


def chance_of(robot: Robot, joint: str, where: str) -> float:
    """Share of the chance of a false doubt that an effect at a place runs with the joint's angle."""
    if where in robot.joints:
        return _OWN if joint == where else _OTHERS / (robot.dof - 1)
    return (_OWN + _OTHERS) / robot.dof


def _known(data: Measurements, fit: Fit, where: str) -> Iterator[tuple[str, Sequence[Array]]]:
    """What else is known of each reading: its name in the results, and columns of shape (m,)."""
    poses, robot = data.poses, fit.model.robot
    if poses.clocked:
        yield "time", [poses.clock]
    if poses.temperature is not None:
        yield "temperature", [poses.warming]
    loads = [np.linalg.norm(poses.wrench[:, :3], axis=-1)]
    if where in robot.joints:
        k = robot.joints.index(where)
        torque = fit.model.state(fit.values, poses).wrench.local[:, k + 1] @ along_axis(robot, k)
        loads.append(torque)
        if poses.motion is not None:
            longest = np.maximum(poses.motion.max(axis=1), _STILL)
            yield f"motion:{where}", [poses.motion[:, k], poses.motion[:, k] / longest]
        if poses.approach is not None:
            yield f"approach:{where}", [poses.approach[:, k]]
    yield "load", loads
    count = np.maximum(data.seen.sum(axis=1), 1)
    yield "range", [(np.linalg.norm(data.points, axis=-1) * data.seen).sum(axis=1) / count]


def _varies(column: Array) -> bool:
    return bool(np.ptp(column) > _STILL * max(1.0, float(np.abs(column).max())))


def _centred(column: Array, kept: Mask) -> Array:
    """Of mean zero and a root mean square of one over the readings that count."""
    return np.asarray((column - column[kept].mean()) / column[kept].std())
