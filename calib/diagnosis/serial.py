"""Scatter is only what scatters: what runs smoothly with something known is structure.

What each joint, and the tip, was off by from configuration to configuration is predicted by the mixed
model. Sorted by time, an angle or a move, independent values have a ratio of the mean squared
successive difference to the variance of about two; of a smooth run it is far less (von Neumann, Annals
of Mathematical Statistics 12(4), 1941). The smallest p counts over all values and variables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, by_size, stacked
from calib.diagnosis.functions import pose_variables
from calib.diagnosis.stage import Fit, Stage
from calib.effects.context import ARM

_FEWEST = 12  # configurations, and distinct values of a variable
_BY_CHANCE = 0.01  # over all that is tested


@dataclass(frozen=True)
class SmoothRun:
    """What passes for scatter and runs smoothly with a variable.

    p : float, probability of as smooth a run by chance, over all that was tested
    """

    where: str
    depends_on: str
    p: float


def smooth_run(stage: Stage, fit: Fit) -> SmoothRun | None:
    """The smoothest run of what passes for scatter, None where all may be chance."""
    if not fit.variances.configuration.any():
        return None
    tested = list(_runs(stage, fit))
    if not tested:
        return None
    first = min(tested, key=lambda run: run.p)
    p = first.p * len(tested)
    return SmoothRun(first.where, first.depends_on, p) if p < _BY_CHANCE else None


def _runs(stage: Stage, fit: Fit) -> Iterator[SmoothRun]:
    first = np.unique(stage.data.poses.configuration, return_index=True)[1]
    kept = first[~stage.dropped[first]]
    robot, values = fit.model.robot, scattered(stage, fit)[kept]
    poses, shuffled = stage.data.poses.take(kept), np.random.default_rng(0).permutation(len(kept))
    for name, variable in pose_variables(robot, poses).items():
        x = variable.at(poses)
        if len(np.unique(np.round(x, 9))) < _FEWEST:
            continue
        order = shuffled[np.argsort(x[shuffled], kind="stable")]  # equal ones in no order
        for k in np.flatnonzero(values.any(axis=0)):
            yield SmoothRun(_place(robot, int(k)), name, chance_of_run(values[order, k]))


def _place(robot: Robot, lever: int) -> str:
    return robot.joints[lever] if lever < robot.dof else ARM


def scattered(stage: Stage, fit: Fit) -> Array:
    """What each joint and the tip was off by at every pose's configuration, shape (m, n + 6).

    With levers L of variances s^2 and residuals r of a configuration, ``s^2 L^T V^-1 r``.
    """
    scatter, v = stage.scatter, fit.variances
    rows = fit.observation.rows(scatter.levers)
    variance, again = v.configuration[scatter.kinds], v.approach[scatter.kinds]
    found = np.zeros((len(rows), rows.shape[-1]))
    for index in by_size(scatter.configuration):
        for own in index:
            L, r = stacked(rows[own]), fit.r[own].ravel()
            approaches = scatter.approach[own][:, None] == scatter.approach[own]
            each = np.kron(approaches, np.ones((rows.shape[1], rows.shape[1])))
            V = (L * variance) @ L.T + each * ((L * again) @ L.T) + v.scale**2 * np.eye(len(r))
            found[own] = variance * (L.T @ np.linalg.solve(V, r))
    return found


def chance_of_run(values: Array) -> float:
    """Probability that independent values (n,) run as smoothly, by the normal approximation."""
    from scipy.special import ndtr

    n, off = len(values), values - values.mean()
    ratio = float((np.diff(values) ** 2).sum() / (off**2).sum())
    return float(ndtr((ratio - 2.0) / np.sqrt(4.0 * (n - 2) / (n**2 - 1))))
