"""What is expected of the estimate after each further pose, as ``calib.identify`` will say it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.model import Model
from calib.model.covariance import (
    covariance,
    identifiable,
    ignorance,
    task_error,
)
from calib.scatter.poses import Mixing
from doe.ahead.lacking import Unnoticed
from doe.criteria import Criterion
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.exchange import greedy
from doe.problem.linearisation import Rows

_SURE = 0.95
_MANY = 1e6  # degrees of freedom: known
_ROUNDING = 1e-12  # of the largest information, below which a smaller one is lost
_OPEN = 0.05**2  # information of a direction that is as uncertain as twenty plausible sizes


@dataclass(frozen=True, eq=False)
class Told:
    """What readings tell: the normal equations of least squares, and the noise in them.

    root : ndarray, shape (p, p), R with ``R^T R`` the sum of the rows' squares
    core : ndarray, shape (p, p), covariance of the equations' right side; None for independent rows of
        unit variance, where it is ``R^T R``
    crossed : ndarray, shape (p, b), what errors common to all readings put there
    """

    root: Array
    core: Array | None
    crossed: Array

    def beside(self, other: Told) -> Told:
        """Both, of other configurations."""
        both = root(np.concatenate([self.root, other.root]))
        crossed = self.crossed + other.crossed
        if self.core is None or other.core is None:
            return Told(both, None, crossed)
        return Told(both, self.core + other.core, crossed)

    def covariance(self, span: Array) -> Array:
        """Of the least-squares values along ``span`` (p, k), shape (p, p)."""
        bread = covariance(self.root, span)
        return bread if self.core is None else np.asarray(bread @ self.core @ bread)

    def response(self, span: Array) -> Array:
        """Of those values to one standard uncertainty of each common error, shape (p, b)."""
        return np.asarray(covariance(self.root, span) @ self.crossed)


@dataclass(frozen=True, eq=False)
class Step:
    """What will be known after one more pose.

    pose : str, empty for what is known now; readings : int, in all
    task_rms, task_worst : float, m, expected at the targets; what is open is off by its plausible
        size, as far as the others do not make up for it
    task_most : float, m, that the error at the targets exceeds once in twenty
    common : float, m, the part of ``task_rms`` by errors common to all readings
    from_parameters : float, m, the part of ``task_rms`` that more readings lower
    std : ndarray, shape (p,), SI, NaN for what is open
    open : tuple of str, parameters that cannot be told
    """

    pose: str
    readings: int
    task_rms: float
    task_worst: float
    task_most: float
    from_parameters: float
    std: Array
    open: tuple[str, ...]
    common: float = 0.0


@dataclass(frozen=True, eq=False)
class Forecast:
    """Where accuracy is wanted.

    rows : ndarray, shape (targets, r, p), m per plausible size, the mean over the markers in them
    weights : ndarray, shape (targets,), summing to one
    beside : ndarray, shape (targets,), m, error that no reading lowers: the arm's scatter, and what the
        model lacks
    seen : float, m, error that poses showed which the fit was without: the least that holds now
    dof : float, degrees of freedom behind the noise, infinite where it is known
    unnoticed : Unnoticed, what the bound allows for beside that
    predicted : ndarray, shape (targets, r, b), m, how predictions follow errors common to all readings
    """

    model: Model
    rows: Array
    weights: Array
    beside: Array
    seen: float
    dof: float
    unnoticed: Unnoticed
    predicted: Array

    def steps(
        self, known: Told, readings: int, further: Iterable[tuple[str, int, Told]]
    ) -> Iterator[Step]:
        """What is known now, then with each further pose: its name, the readings it adds, and all that
        is told by then.

        Rows are in standard deviations per plausible size.
        """
        now = self._step("", readings, known)
        yield replace(now, task_most=max(now.task_most, self.seen))
        for name, count, told in further:
            readings += count
            yield self._step(name, readings, told)

    def _step(self, pose: str, readings: int, told: Told) -> Step:
        p = self.rows.shape[-1]
        ids = tuple(parameter.id for parameter in self.model.parameters)
        choice = identifiable(told.root, np.ones(p), ids)
        known = np.zeros(p, dtype=bool)
        known[choice.kept] = True
        span = np.eye(p)[:, choice.kept]
        cov = told.covariance(span) + ignorance(told.root, span, np.ones(p), ~known)
        squared = ((self.rows @ cov) * self.rows).sum(axis=(1, 2))
        own = np.sqrt(np.maximum(squared, 0.0))
        parameters = task_error(own, self.weights)[0]
        response = told.response(span)
        missed = self.rows @ response - self.predicted
        common = np.sqrt((missed**2).sum(axis=(1, 2)))
        beside = np.hypot(common, self.beside)
        rms, worst = task_error(np.hypot(own, beside), self.weights)
        variances = np.maximum(np.diag(cov), 0.0) + (response**2).sum(axis=1)
        std = np.where(known, np.sqrt(variances) * self.model.sizes, np.nan)
        lost = tuple(name for entry in choice.unidentifiable for name in entry.names)
        doubted = np.hypot(rms * self.unnoticed.louder, self.unnoticed.at_targets)
        most = float(doubted) * self._margin(cov, missed, rms)
        by_common = task_error(common, self.weights)[0]
        return Step(pose, readings, rms, worst, most, parameters, std, lost, by_common)

    def _margin(self, cov: Array, missed: Array, rms: float) -> float:
        """By how much the error exceeds its expectation once in twenty.

        One draw of the parameters and of the common errors, ``missed`` (targets, r, b) by one standard
        uncertainty of each, errs by ``sum lambda_i z_i^2``, a chi-square by its first two moments
        (Welch and Satterthwaite); the noise behind the expectation is an estimate as well. Their ratio
        has an F distribution.
        """
        from scipy.special import fdtri

        share = np.sqrt(self.weights)[:, None, None]
        half, shared = (self.rows * share).reshape(-1, len(cov)), missed * share
        shared = shared.reshape(len(half), missed.shape[-1])
        # The same sums of squares in p + b rows: of values and common errors side by side.
        both = np.concatenate([half, shared], axis=1)
        inner = both.T @ both
        p, b = len(cov), shared.shape[1]
        spreads = np.zeros((p + b, p + b))
        spreads[:p, :p], spreads[p:, p:] = cov, np.eye(b)
        spread = np.linalg.eigvals(spreads @ inner).real
        squares = float((spread**2).sum())
        drawn = rms**4 / squares if squares > 0.0 else _MANY  # nothing is open: nothing exceeds it
        return float(np.sqrt(fdtri(min(drawn, _MANY), min(self.dof, _MANY), _SURE)))


def told(
    rows: Rows,
    moved: Rows,
    chosen: Mask | None = None,
    held: Array | None = None,
    pull: float = 1.0,
    weighing: Mixing | None = None,
) -> Told:
    """What readings tell together, all or some of them, (m,), beside rows ``held`` (k, p).

    moved : Rows, how the same readings follow errors common to all
    pull, weighing : how the estimate weighs the rows beside them, and theirs, as an observation has it
    """
    own = counted = rows.whitened if chosen is None else rows.whitened * chosen[:, None, None]
    if weighing is not None:
        counted = weighing(own)
        own = weighing.back(counted)
    crossed = np.einsum("mrp,mrb->pb", own, moved.whitened)
    core = None if rows.mixing is None else rows.mixing.covariance(own)
    flat = stacked(counted)
    if held is None:
        return Told(root(flat), core, crossed)
    held = pull * held  # and so is the error of these rows, of which core is made
    both = root(np.concatenate([flat, held]))
    return Told(both, None if core is None else core + pull**2 * held.T @ held, crossed)


def root(rows: Array) -> Array:
    """R (p, p) with ``R^T R = rows^T rows``."""
    R = np.linalg.qr(rows, mode="r")
    return np.concatenate([R, np.zeros((rows.shape[1] - len(R), rows.shape[1]))])


def open_beside(blocks: Blocks) -> Blocks:
    """Candidates beside what is known, of which what nothing tells counts as twenty plausible sizes."""
    largest = max(np.abs(blocks.fixed).max(initial=0.0), np.abs(blocks.packed).max(initial=0.0))
    least = max(_OPEN, _ROUNDING * float(largest)) * np.eye(len(blocks.fixed))
    return Blocks(blocks.packed, blocks.fixed + least, blocks.rank)


def best_next(criterion: Criterion, blocks: Blocks, count: int) -> IntArray:
    """The candidates that add most, one after the other, beside what is known already.

    What is open is closed first.
    """
    rules = Allowed(np.zeros(len(blocks), dtype=int), np.zeros(1), np.array([count]), 1)
    return greedy(criterion, open_beside(blocks), rules)
