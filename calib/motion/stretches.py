"""How long the errors of a motion remember each other: what is shorter is no independent evidence."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.motion.effects import EFFECTS, JointMotion
from calib.motion.filtering import filtered
from calib.motion.motions import Motions
from calib.motion.regressor import nominal_inertials, regressor

_DISTANCE = 1e3  # 1/rad, of pre-sliding
_SHORTEST = 0.2  # s
_USUAL = ("torque_offset", "coulomb_friction", "viscous_friction", "armature", "pre_sliding")


def correlation_time_of(cell: Cell, motions: Motions) -> float:
    """Autocorrelation time of what usual friction and armature leave, s; the median over joints."""
    times = []
    for run in motions.runs:
        samples = filtered(run, cell.motion.cutoff)
        if not len(samples):
            continue
        Y = regressor(cell.robot, samples.q, samples.v, samples.a, cell.gravity)
        rigid = Y @ nominal_inertials(cell.robot).ravel()
        for j in range(cell.robot.dof):
            joint, effort = JointMotion.of(samples, rigid, cell.robot, j), samples.effort[:, j]
            terms = [EFFECTS[kind](_DISTANCE).columns(joint) for kind in _USUAL]
            X = np.column_stack([joint.rigid, *terms])
            left = effort - X @ np.linalg.lstsq(X, effort, rcond=None)[0]
            times.append(correlation_time(left) * run.step)
    return max(float(np.median(times)), _SHORTEST) if times else _SHORTEST


def correlation_time(x: Array) -> float:
    """Steps of a series (m,) that are worth one: ``1 + 2 sum rho`` up to its first zero."""
    x = x - x.mean()
    size = 2 ** int(np.ceil(np.log2(2 * len(x))))
    power = np.abs(np.fft.rfft(x, size)) ** 2
    rho = np.fft.irfft(power)[: len(x)]
    if rho[0] <= 0.0:
        return 1.0
    rho = rho / rho[0]
    end = int(np.argmax(rho < 0.0)) or len(rho)
    return float(1.0 + 2.0 * rho[1:end].sum())
