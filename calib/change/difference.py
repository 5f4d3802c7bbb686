"""The difference of two estimates, in what both determine.

Frames and markers may differ between the days: a base or a marker is compared where it stands within
:data:`SAME_PLACE` of where it stood. Else the instrument, the marker or the tool was put elsewhere, and
says nothing of the robot: it stays free, as any unknown of the day does.

What a day left open (:meth:`calib.change.known.DayEstimate.ignorance`) stood at nominal, and least
squares put part of it into the others: ``d = e + (V_after - V_before) u`` with u the true errors.
Rows that see u are taken out, so no plausible size enters, and what poses of both days took up
alike stays compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, Mask
from calib.change.known import DayEstimate
from calib.effects import catalogue
from calib.errors import CalibError
from calib.population.prior import Key

SAME_PLACE = 0.02
"""m and rad: frames and markers within it are taken for the same."""
FALSE_ALARM = 0.02
"""How often anything is said to have changed where nothing has."""
LEAVES_MORE = 0.005
"""How often a later fit is said to leave more where it does not."""
_PLACES = ("base", "tool")
_FELT = 0.1  # standard deviations: what an open parameter of plausible size may shift a row by
_NUMERICAL = 1e-10  # of the largest eigenvalue of a correlation matrix


@dataclass(frozen=True, eq=False)
class Difference:
    """After minus before.

    keys : tuple of Key, the k parameters that are compared
    change : ndarray, shape (k,), SI
    covariance : ndarray, shape (k, k), SI, by the noise of both days
    later : ndarray, shape (k, k), SI, what the later day does not know
    unseen : ndarray, shape (k, u), SI, how the difference follows what a day left open
    dof : float, of the noise of both days together
    apart : tuple of str, bases and markers that stand elsewhere, ``base:..`` or ``tool:marker:..``
    left : tuple of float, m, RMS that each fit leaves; grown : float, probability that the later leaves
        as much more by chance
    lacking : ndarray, shape (k, k), SI, part of the covariance by what the model lacks
    alone : dict, parameter of one result only -> its size there in standard deviations
    """

    keys: tuple[Key, ...]
    change: Array
    covariance: Array
    later: Array
    unseen: Array
    dof: float
    apart: tuple[str, ...]
    alone: Mapping[Key, float]
    left: tuple[float, float]
    grown: float
    lacking: Array | float = 0.0

    @cached_property
    def half(self) -> Array:
        """Rows W, shape (n, k): ``W change`` has unit variance blind to what a day left open."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        scale = np.where(std > 0.0, std, 1.0)
        roots, axes = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        kept = roots > _NUMERICAL * roots.max(initial=0.0)
        W = np.asarray((axes[:, kept] / np.sqrt(roots[kept])).T / scale)
        U, felt, _ = np.linalg.svd(W @ self.unseen, full_matrices=True)
        return np.asarray(U[:, int((felt > _FELT).sum()) :].T @ W)

    @cached_property
    def whitened(self) -> Array:
        """The difference in independent rows of unit variance, shape (n,)."""
        return np.asarray(self.half @ self.change)

    @cached_property
    def best(self) -> tuple[Array, Array]:
        """The difference (k,) with what a day left open at its likeliest, and its covariance (k, k)."""
        back = self.covariance @ self.half.T
        return back @ self.whitened, back @ back.T * self.wider

    @property
    def doubt(self) -> Array:
        """Covariance (k, k) of the difference as an error of the earlier values on the later day."""
        return np.asarray(self.later * self.wider + self.lacking)

    @property
    def wider(self) -> float:
        """Factor of a variance that itself is known by few degrees of freedom: that of Student's t."""
        return self.dof / (self.dof - 2.0) if self.dof > 3.0 else 3.0

    @cached_property
    def determined(self) -> Mask:
        """Which parameters both days determine by themselves, shape (k,)."""
        open_ = (self.unseen**2).sum(axis=1)
        noise = np.diag(self.covariance)
        return np.asarray((noise > 0.0) & (open_ < _FELT**2 * noise))

    @property
    def statistic(self) -> float:
        """The squared difference in its standard deviations, over ``len(whitened)`` rows."""
        return float(self.whitened @ self.whitened)

    @cached_property
    def p_value(self) -> float:
        """Probability of so large a statistic where nothing changed."""
        return tail(self.statistic, len(self.whitened), self.dof)

    @cached_property
    def std(self) -> Array:
        """Of each difference, shape (k,), SI; NaN where a day does not determine it."""
        noise = np.maximum(np.diag(self.covariance), 0.0)
        return np.where(self.determined, np.sqrt(noise), np.nan)

    @cached_property
    def family_p(self) -> Array:
        """P value of each parameter, shape (k,), by Holm's step-down over all of them
        (Scand. J. Statist. 6, 1979).
        """
        from scipy.special import stdtr

        return holm(2.0 * stdtr(min(self.dof, 1e9), -np.abs(self.change) / self.std))

    @property
    def changed(self) -> bool:
        """Whether anything changed, with false alarms held over all parameters together."""
        return self.p_value < FALSE_ALARM

    @property
    def changed_parameters(self) -> Mask:
        """Which parameters did, shape (k,), named only where something changed at all."""
        return np.asarray(self.changed & (self.family_p < FALSE_ALARM))

    @property
    def leaves_more(self) -> bool:
        """Whether the later fit leaves surely more: something came up that the model lacks."""
        return self.grown < LEAVES_MORE


def difference(before: DayEstimate, after: DayEstimate) -> Difference:
    """What lies between two results. Raises CalibError where they have nothing in common."""
    from scipy.special import fdtrc

    alone = {key: z for known, other in ((before, after), (after, before))
             for key, z in _alone(known, other).items()}  # fmt: skip
    before, after = (known.restricted(_alone(known, other))
                     for known, other in ((before, after), (after, before)))  # fmt: skip
    apart = _apart(before, after)
    keys = tuple(key for key in after.keys if key in set(before.keys) and _compared(key, apart))
    if not any(key[0] not in _PLACES for key in keys):
        raise CalibError("the results have no parameter of the robot in common")
    rows = [np.array([known.keys.index(key) for key in keys]) for known in (before, after)]
    noise = [
        known.noise()[np.ix_(own, own)] for known, own in zip((before, after), rows, strict=True)
    ]
    change = after.values[rows[1]] - before.values[rows[0]]
    for i, (effect, where, name) in enumerate(keys):
        marker = where.removeprefix("marker:")
        if (
            effect == "tool" and marker in after.markers
        ):  # values count from guesses that may differ
            change[i] = (after.markers[marker] - before.markers[marker])["xyz".index(name)]
    grown = 1.0  # poses err independently
    if before.left > 0.0 and after.left > 0.0:
        ratio = (after.left / before.left) ** 2
        grown = float(fdtrc(after.approaches, before.approaches, ratio))
    return Difference(
        keys,
        change,
        noise[0] + noise[1],
        after.covariance[np.ix_(rows[1], rows[1])],
        _unseen(before, after, rows),
        _freedom(noise, (before.dof, after.dof)),
        apart,
        alone,
        (before.left, after.left),
        grown,
    )


def lasting(key: Key) -> bool:
    """Whether a parameter is the robot's own, of an effect that is known here."""
    kind = catalogue().get(key[0])
    return kind is not None and kind.lasting


def _alone(known: DayEstimate, other: DayEstimate) -> dict[Key, float]:
    """Parameters of the robot that the other result lacks, in standard deviations from nothing."""
    std = np.sqrt(np.diag(known.covariance))
    return {
        key: float(abs(value) / s) if s > 0.0 else 0.0
        for key, value, s in zip(known.keys, known.values, std, strict=True)
        if lasting(key) and key not in other.keys
    }


def _apart(before: DayEstimate, after: DayEstimate) -> tuple[str, ...]:
    """Bases and markers of both results that stand elsewhere."""
    found = []
    shared = [key for key in after.keys if key[0] == "base" and key in before.keys]
    for where in dict.fromkeys(key[1] for key in shared):
        own = [key for key in shared if key[1] == where]
        then, now = (
            np.array([known.values[known.keys.index(key)] for key in own])
            for known in (before, after)
        )
        if np.abs(now - then).max() > SAME_PLACE:
            found.append(f"base:{where}")
    for name in after.markers:
        moved = name in before.markers and np.abs(after.markers[name] - before.markers[name]).max()
        if moved > SAME_PLACE:
            found.append(f"tool:marker:{name}")
    return tuple(found)


def _compared(key: Key, apart: tuple[str, ...]) -> bool:
    if key[0] in _PLACES:
        return f"{key[0]}:{key[1]}" not in apart
    return lasting(key)


def _unseen(before: DayEstimate, after: DayEstimate, rows: list[Array]) -> Array:
    """How the rows follow the errors that either day left open, shape (k, u)."""
    (names, then), (others, now) = before.ignorance(), after.ignorance()
    every = tuple(dict.fromkeys((*names, *others)))
    D = np.zeros((len(rows[0]), len(every)))
    D[:, [every.index(key) for key in others]] += now[rows[1]]
    D[:, [every.index(key) for key in names]] -= then[rows[0]]
    return D


def _freedom(noise: list[Array], dof: tuple[float, float]) -> float:
    """Degrees of freedom of a sum of two covariances (Welch and Satterthwaite), by their shares."""
    total = noise[0] + noise[1]
    std = np.sqrt(np.maximum(np.diag(total), 0.0))
    scale = np.outer(*2 * [np.where(std > 0.0, std, 1.0)])
    inverse = np.linalg.pinv(total / scale, rcond=_NUMERICAL, hermitian=True)
    shares = np.array([np.trace(inverse @ (own / scale)) for own in noise])
    if not shares.sum() > 0.0:
        return max(dof)
    shares = shares / shares.sum()
    return float(1.0 / max(float((shares**2 / np.array(dof)).sum()), 1e-12))


def tail(statistic: float, rows: int, dof: float) -> float:
    """Probability of a larger sum of squares of so many rows, whose unit has dof degrees of freedom."""
    from scipy.special import chdtrc, fdtrc

    if not rows:
        return 1.0
    if dof > 1e8:
        return float(chdtrc(rows, statistic))
    return float(fdtrc(rows, dof, statistic / rows))


def holm(p: Array) -> Array:
    """P values that hold over the family, shape (k,); NaN is no member."""
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known])]
    stepped = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1))
    out = np.full(len(p), np.nan)
    out[order] = np.minimum(stepped, 1.0)
    return out
