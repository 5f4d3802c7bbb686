"""The error at the targets beside the rivals of a diagnosis: what poses do for both at once.

Of either, what a plan reaches counts as a share of what as many poses for it alone would reach, from
what the data know already. Shares have no unit and can be added: a compound criterion, as that of
McGree, Eccleston and Duffull (J. Biopharm. Stat. 18(2), 2008) for D and T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.diagnosis import Diagnosis
from calib.effects.tool import Tool
from doe.problem.information import Regressor
from doe.problem.problem import target_rows
from doe.prospect.rivals.evidence import FREE, Known
from doe.prospect.rivals.search import Search, worst
from doe.prospect.situation import Situation


@dataclass(frozen=True, eq=False)
class Accuracy:
    """The expected error at the targets; its value is less the logarithm of its RMS.

    Z : ndarray, shape (p, n), from whitened rows to coordinates of ``Known``; p of the user's model
    aims : ndarray, shape (k, n), m: ``tr(aims P aims^T)`` is the mean square
    """

    Z: Array
    aims: Array

    @property
    def data(self) -> Known:
        n, none = self.Z.shape[1], np.zeros((0, 0))
        return Known(np.eye(n), np.zeros((n, 0)), none, np.zeros(0), 0)

    def added(self, known: Known, rows: Array, q: Array) -> Known:
        del q
        return known.added(self._blocks(rows))

    def values(self, known: Known) -> Array:
        square = np.trace(self.aims @ known.P @ self.aims.T)
        return np.asarray([-0.5 * np.log(square)])

    def tried(self, known: Known, rows: Array, q: Array) -> Array:
        del q
        A = self._blocks(rows)
        AP = A @ known.P
        V = AP @ np.swapaxes(A, -1, -2) + np.eye(A.shape[-2])
        at = AP @ self.aims.T
        fall = (at * np.linalg.solve(V, at)).sum(axis=(-1, -2))
        square = np.trace(self.aims @ known.P @ self.aims.T) - fall
        return np.asarray(-0.5 * np.log(square))[..., None]

    def _blocks(self, rows: Array) -> Array:
        return np.asarray(rows[..., : len(self.Z)] @ self.Z)


def accuracy_of(situation: Situation, diagnosis: Diagnosis, rows: Array) -> Accuracy:
    """At the targets of the cell, after the data with independent rows (N, p), for the user's model."""
    model = diagnosis.stage.model
    p, values = len(model.parameters), diagnosis.after.values[: len(model.parameters)]
    regressor = Regressor(situation.cell, model, values, np.diag(model.sizes))
    targets, weights = targets_of(situation.cell)
    at_markers = any(isinstance(e, Tool) for e in model.effects)
    aims = target_rows(regressor, targets, at_markers)
    aims = (aims * np.sqrt(weights / weights.sum())[:, None, None]).reshape(-1, p)
    known = np.concatenate([rows[:, :p] * model.sizes, regressor.known, np.eye(p) / FREE])
    inverse = np.linalg.inv(np.linalg.qr(known, mode="r"))
    # As many rows as parameters say the same of so many targets.
    root = np.asarray(np.linalg.qr(aims @ inverse, mode="r"))
    return Accuracy(model.sizes[:, None] * inverse, root)


@dataclass(frozen=True, eq=False)
class Shares:
    """What is reached of what poses for one alone would reach: of the causes, and of the accuracy.

    The accuracy is the last place. now, best : values of the two, with the data and at best
    """

    now: tuple[float, float]
    best: tuple[float, float]

    def of(self, values: Sequence[Array]) -> tuple[Array, Array]:
        """Both shares of the values of all places (..., k), shape (...)."""
        reached = worst(values[:-1]), values[-1][..., 0]
        first, second = (
            (own - now) / max(best - now, 1e-9)
            for own, now, best in zip(reached, self.now, self.best, strict=True)
        )
        return np.asarray(first), np.asarray(second)

    def __call__(self, values: Sequence[Array]) -> Array:
        """The mean of both."""
        first, second = self.of(values)
        return np.asarray(0.5 * (first + second))


def with_accuracy(search: Search, accuracy: Accuracy, count: int) -> Search:
    """The search for causes and accuracy together."""
    alone = replace(search, places=(accuracy,), weigh=lambda values: values[-1][..., 0])
    both = replace(search, places=(*search.places, accuracy))
    ends = search.value(search.best_plan(count)), alone.value(alone.best_plan(count))
    return replace(both, weigh=Shares((search.value(()), alone.value(())), ends))
