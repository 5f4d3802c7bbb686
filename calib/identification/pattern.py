"""What outliers have in common: those that share a posture are a signal, not a fault.

Gross errors fall on poses by chance. Poses that a model fails stand together: in one part of a joint's
range, under load, at one time. If k of n poses are drawn by chance and ordered by a variable, c of them
that follow each other span d steps with probability ``C(d - 1, c - 2) C(n - d, k - c + 1) / C(n, k)``,
wherever they begin (the spacings of a random subset are exchangeable). So c within s poses has at most
``(k - c + 1)`` times the probability of d < s, and Bonferroni counts the variables and the numbers c
that are tried. Poses of equal value count as within, which errs to the safe side.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.poses import Measurements, Poses

SURELY = 0.01
"""Probability by chance below which outliers share something."""
_MOST_OF_THEM = 2.0 / 3.0
_FEW = 0.5  # share of all poses that the interval may hold
_ALONE = 0.15  # of the range of the others: how far beyond them a pose is extrapolated
_LUCK = 0.5  # that an outlier falls on such a pose: above, they say nothing of it


@dataclass(frozen=True, eq=False)
class Variable:
    """Something that is known of a pose; ``name`` as in the results, such as ``q:A3``.

    values : ndarray, shape (m,), in SI; unit : str, for people, and scale : float, SI per unit
    """

    name: str
    values: Array
    unit: str
    scale: float


@dataclass(frozen=True)
class Shared:
    """Where the outliers stand together.

    variable : str, as in the results; low, high : float, SI, ends of the interval
    inside : int, poses in it, of ``poses``; outliers : int, of them set aside, of ``of``
    p : float, probability by chance that so many stand so close in any variable
    unit, scale : str and float, for people, and SI per unit
    alone : float, SI, how far a single outlier lies beyond all other poses, None where several share
    """

    variable: str
    low: float
    high: float
    inside: int
    poses: int
    outliers: int
    of: int
    p: float
    unit: str
    scale: float
    alone: float | None = None

    def __str__(self) -> str:
        name = self.variable.removeprefix("q:")
        if self.alone:
            return (
                f"{name} = {self.high / self.scale:.4g} {self.unit}, "
                f"{self.alone / self.scale:.3g} {self.unit} beyond every other pose"
            )
        low, high = (value / self.scale + 0.0 for value in (self.low, self.high))
        span = f"{low:.4g} to {high:.4g}" if low != high else f"{low:.4g}"
        return f"{name} in {span} {self.unit}".rstrip()


def variables_of(robot: Robot, data: Measurements) -> tuple[Variable, ...]:
    """Variables known of each pose that differ among the poses."""
    # Mean distance of the visible points from the origin of the readings.
    lengths = np.linalg.norm(data.points, axis=-1) * data.seen
    ranges = lengths.sum(axis=1) / np.maximum(data.seen.sum(axis=1), 1)
    found = (*_of_poses(robot, data.poses), Variable("range", ranges, "m", 1.0))
    return tuple(v for v in found if np.isfinite(v.values).all() and np.ptp(v.values) > 0.0)


def _of_poses(robot: Robot, poses: Poses) -> Iterator[Variable]:
    degree = float(np.pi / 180.0)
    for k, joint in enumerate(robot.joints):
        unit, scale = ("mm", 1e-3) if robot.prismatic[k] else ("deg", degree)
        yield Variable(f"q:{joint}", poses.q[:, k], unit, scale)
        if poses.approach is not None:
            yield Variable(f"approach:{joint}", poses.approach[:, k], "", 1.0)
    pulls = np.linalg.norm(poses.wrench[:, :3], axis=1) + 9.80665 * poses.load_mass
    yield Variable("load", pulls, "N", 1.0)
    if poses.temperature is not None:
        yield Variable("temperature", poses.temperature, "degC", 1.0)
    if poses.time is not None:
        yield Variable("time", poses.elapsed, "s", 1.0)
    else:
        yield Variable("order", np.arange(1.0, len(poses) + 1.0), "(reading)", 1.0)


def shared(variables: tuple[Variable, ...], outlier: Mask) -> Shared | None:
    """The one variable in which the outliers stand together, None where chance explains them.

    outlier : ndarray of bool, shape (m,)
    """
    k = int(outlier.sum())
    if not k or not variables:
        return None
    least = max(2, int(np.ceil(_MOST_OF_THEM * k)))
    tried = len(variables) * max(1, k - least + 1)
    found = [
        close
        for variable in variables
        for c in range(least, k + 1)
        if (close := _closest(variable, outlier, c, tried)) is not None
    ]
    best = min(found, key=lambda own: own.p, default=None)
    if best is not None and best.p < SURELY:
        return best
    return _extrapolated(variables, outlier)


def _closest(v: Variable, outlier: Mask, c: int, tried: int) -> Shared | None:
    """The c outliers whose interval holds the fewest poses; None where it holds half of all."""
    n, k = len(outlier), int(outlier.sum())
    own, every = np.sort(v.values[outlier]), np.sort(v.values)
    low, high = own[: k - c + 1], own[c - 1 :]
    inside = np.searchsorted(every, high, "right") - np.searchsorted(every, low, "left")
    i = int(inside.argmin())
    s = int(inside[i])
    if s > _FEW * n:
        return None
    held = int(((own >= low[i]) & (own <= high[i])).sum())
    p = min(1.0, tried * (k - c + 1) * within(n, k, c, s))
    return Shared(v.name, float(low[i]), float(high[i]), s, n, held, k, p, v.unit, v.scale)


def within(n: int, k: int, c: int, s: int) -> float:
    """Probability that c neighbours among k of n, drawn by chance, lie within s positions."""
    from scipy.special import gammaln

    def log_choose(a: Array | float, b: float) -> Array:
        return np.asarray(gammaln(a + 1.0) - gammaln(b + 1.0) - gammaln(a - b + 1.0))

    d = np.arange(c - 1.0, min(s - 1, n - k + c - 1) + 1.0)
    logs = log_choose(d - 1.0, c - 2.0) + log_choose(n - d, k - c + 1.0) - log_choose(float(n), k)
    return float(min(1.0, np.exp(logs).sum()))


def _extrapolated(variables: tuple[Variable, ...], outlier: Mask) -> Shared | None:
    """An outlier that lies alone far beyond all other poses; p is that any falls on such a pose.

    That the model is extrapolated there is so whatever the chance.
    """
    from scipy.special import gammaln

    ends = [beyond(v.values) if v.name.startswith("q:") else {} for v in variables]
    reached = {i for own in ends for i in own}
    hits = [
        (gap / np.ptp(v.values), v, i, gap)
        for v, own in zip(variables, ends, strict=True)
        for i, gap in own.items()
        if outlier[i]
    ]
    n, k, e = len(outlier), int(outlier.sum()), len(reached)
    # No outlier among the e of n that lie so: C(n - e, k) / C(n, k).
    missed = gammaln(n - e + 1) - gammaln(n - e - k + 1) - gammaln(n + 1) + gammaln(n - k + 1)
    p = float(-np.expm1(missed))
    if not hits or p > _LUCK:
        return None
    _, v, i, gap = max(hits, key=lambda hit: hit[0])
    at = float(v.values[i])
    return Shared(v.name, at, at, 1, n, 1, k, p, v.unit, v.scale, gap)


def beyond(values: Array) -> dict[int, float]:
    """Positions of the one or two values that lie far beyond all others, and by how much."""
    order = np.argsort(values, kind="stable")
    if len(order) < 4:
        return {}
    ends = ((order[0], order[1], order[-1]), (order[-1], order[-2], order[0]))
    found = {}
    for end, following, other in ends:
        gap = float(abs(values[end] - values[following]))
        if gap > _ALONE * float(abs(values[other] - values[following])):
            found[int(end)] = gap
    return found
