"""Whether a named effect has the right shape: its size should not vary from pose to pose.

A cause whose place and variable are right, but not its form, leaves a residual that is the effect
itself times some function of the posture. So what the fitted effect does at each pose is multiplied
by the first two harmonics of each joint, and the score test asks whether any of it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.diagnosis.screen import field, score
from calib.diagnosis.stage import Fit
from calib.effects.protocol import Effect
from calib.poses import Poses
from calib.robot import Robot
from calib.se3 import Array

_OWN = 0.8


@dataclass(frozen=True)
class Doubt:
    """What speaks against the shape of an effect.

    p : float, probability of as much by chance; joint : str, with which its size varies most
    fall : float, of the sum of squares
    """

    p: float
    joint: str
    fall: float


def shape_doubt(robot: Robot, poses: Poses, fit: Fit, effect: Effect, causes: int = 1) -> Doubt:
    """The strongest doubt; most of the chance of a false one goes to the effect's own joint.

    causes : int, among which the chance is shared
    """
    own = fit.positions(effect)
    done = fit.J[..., own] @ fit.values[own]
    r, J = fit.equations
    found = []
    for k, joint in enumerate(robot.joints):
        X = np.zeros((len(r), 4))
        X[: done.size] = (done[..., None] * _harmonics(robot, poses, k)[:, None, :]).reshape(-1, 4)
        beside = score(field(J @ fit.span, X, r), np.arange(4))
        found.append((beside.p * _tests(robot, effect, joint), joint, beside.fall))
    p, joint, fall = min(found)
    return Doubt(min(1.0, causes * p), joint, fall)


def _tests(robot: Robot, effect: Effect, joint: str) -> float:
    """By how much a p value counts for less, as one of all the joints that are asked."""
    if effect.where not in robot.joints:
        return float(robot.dof)
    return 1.0 / _OWN if joint == effect.where else (robot.dof - 1) / (1.0 - _OWN)


def _harmonics(robot: Robot, poses: Poses, k: int) -> Array:
    """Cosine and sine of once and twice the angle, shape (m, 4); of a slide, over its travel."""
    q = poses.q[:, k]
    if robot.prismatic[k]:
        q = np.pi * (q - q.mean()) / max(float(np.ptp(q)), 1e-9)
    return np.stack([np.cos(q), np.sin(q), np.cos(2.0 * q), np.sin(2.0 * q)], axis=-1)
