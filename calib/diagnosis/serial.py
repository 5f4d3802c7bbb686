"""Scatter is only what scatters: what runs smoothly with something known is structure.

What each joint, and the tip, was off by in each configuration, and in each approach, is predicted by
the mixed model. Sorted by time, an angle or a move, independent values have a ratio of the mean squared
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
from calib.poses import Poses

_FEWEST = 12  # distinct values of a variable
_SHARE = 0.2  # of the scatter, that a joint or a direction of the tip must have to be asked
_BY_CHANCE = 0.02  # over all that is tested


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
    tested = list(_runs(stage, fit)) if fit.variances.any else []
    if not tested:
        return None
    first = min(tested, key=lambda run: run.p)
    p = first.p * len(tested)
    return SmoothRun(first.where, first.depends_on, p) if p < _BY_CHANCE else None


def _runs(stage: Stage, fit: Fit) -> Iterator[SmoothRun]:
    """Every run of what is new at configurations, and of what is new at approaches."""
    groups = stage.scatter.configuration, stage.scatter.approach
    power = (fit.observation.rows(stage.scatter.levers) ** 2).sum(axis=1)
    for group, off in zip(groups, scattered(stage, fit), strict=True):
        first = np.unique(group, return_index=True)[1]
        kept = first[~stage.dropped[first]]
        moved = (power * off**2)[kept].mean(axis=0)
        off = np.where(moved > _SHARE * moved.sum(), off, 0.0)
        yield from _by_variable(stage.data.poses.take(kept), fit.model.robot, off[kept])


def _by_variable(poses: Poses, robot: Robot, off: Array) -> Iterator[SmoothRun]:
    shuffled = np.random.default_rng(0).permutation(len(off))
    for name, variable in pose_variables(robot, poses).items():
        x = variable.at(poses)
        if len(np.unique(np.round(x, 9))) < _FEWEST:
            continue
        order = shuffled[np.argsort(x[shuffled], kind="stable")]  # equal ones in no order
        for k in np.flatnonzero(off.any(axis=0)):
            yield SmoothRun(_place(robot, int(k)), name, chance_of_run(off[order, k]))


def _place(robot: Robot, lever: int) -> str:
    return robot.joints[lever] if lever < robot.dof else ARM


def scattered(stage: Stage, fit: Fit) -> tuple[Array, Array]:
    """What each joint and the tip was off by at every pose, (m, n + 6) each: anew in its configuration,
    and anew in its approach.

    With levers L of variances s^2 and residuals r of a configuration, ``s^2 L^T V^-1 r``.
    """
    scatter, v = stage.scatter, fit.variances
    rows, R = fit.observation.rows(scatter.levers), fit.r.shape[1]
    variance, again = v.configuration[scatter.kinds], v.approach[scatter.kinds]
    by_configuration, by_approach = np.zeros((2, len(rows), rows.shape[-1]))
    for index in by_size(scatter.configuration):
        for own in index:
            L = stacked(rows[own])
            alike = scatter.approach[own][:, None] == scatter.approach[own]
            each = np.kron(alike, np.ones((R, R)))
            V = (L * variance) @ L.T + each * ((L * again) @ L.T) + v.scale**2 * np.eye(len(L))
            g = L * np.linalg.solve(V, fit.r[own].ravel())[:, None]
            at_poses = g.reshape(len(own), R, -1).sum(axis=1)
            by_configuration[own] = variance * at_poses.sum(axis=0)
            by_approach[own] = again * (alike @ at_poses)
    return by_configuration, by_approach


def chance_of_run(values: Array) -> float:
    """Probability that independent values (n,) run as smoothly, by the normal approximation."""
    from scipy.special import ndtr

    n, off = len(values), values - values.mean()
    ratio = float((np.diff(values) ** 2).sum() / (off**2).sum())
    return float(ndtr((ratio - 2.0) / np.sqrt(4.0 * (n - 2) / (n**2 - 1))))
