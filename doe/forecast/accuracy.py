"""The error at the targets: what is expected of the estimate after each pose, and what none lowers.

No reading lowers the arm's scatter nor what the model lacks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calib.arrays import Array, stacked
from calib.cell.targets import targets_of
from calib.identification import Identification
from calib.inference.coverage import freedom
from calib.model import Model
from calib.model.covariance import identifiable, ignorance, task_error
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Owner
from calib.poses.moves import in_order
from calib.prediction.discrepancy import ModelDiscrepancy, SquaredErrors
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of, fitted_of
from calib.solver import triangle
from doe.criteria.trace import Task
from doe.information import Linearisation, target_rows
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.search import greedy

_SURE = 0.95
_MANY = 1e6  # degrees of freedom: known
_FREE = 10.0  # plausible sizes to which what is open counts as known


@dataclass(frozen=True, eq=False)
class LastingError:
    """The error at the targets that does not average away, RMS, m.

    scatter : the arm errs anew at every target; what the data do not tell from the model's error counts
        here; scatter_of : whose it is: "undecided" where the data leave that open
    of_model : what the model lacks; trend : the part of it by which the day's trend goes on
    at_targets : ndarray, shape (targets,), all of it
    hidden : scatter that the data neither show nor rule out, for which a bound allows beside all that
    missed : the error at poses that the fit was without, less the instrument's noise
    """

    scatter: float
    scatter_of: Owner
    of_model: float
    trend: float
    at_targets: Array
    hidden: float = 0.0
    missed: float = 0.0

    @property
    def rms(self) -> float:
        """All of it."""
        return float(np.hypot(self.scatter, self.of_model))

    @classmethod
    def of(cls, at: Linearisation, found: Identification | None) -> Self:
        """At the targets of a cell; found : of the data so far, None where there is none yet."""
        targets, weights = targets_of(at.cell)

        def rms(errors: Array) -> float:
            return task_error(errors, weights)[0]

        if found is None:
            exact = np.zeros((len(at.values), len(at.values)))
            none = ModelDiscrepancy(0.0, "")
            known = Estimate(at.model, at.values, exact, 0.0, none, (), variances=at.arm)
        else:
            known = estimate_of(found, at.cell.design.targets_after or 0.0)
        # What was never measured the poses to come may show.
        error = ExpectedError(replace(known, unmeasured=()), targets)
        seen = None if found is None else _missed(found)
        lacking = 0.0 if seen is None or found is None else seen.discrepancy * found.footprint
        model = np.maximum(error.model, lacking)
        lasting = cls(
            rms(error.arm),
            "arm" if found is None else known.configuration_of,
            rms(model),
            rms(error.trend),
            np.hypot(error.arm, model),
        )
        if found is None:
            return lasting
        if seen is not None:
            lasting = replace(lasting, missed=seen.beyond(seen.noise) * found.footprint)
        if found.undetected is None:
            return lasting
        unseen = replace(known, variances=found.undetected[1].variances, configuration_of="arm")
        return replace(lasting, hidden=rms(ExpectedError(unseen, targets).arm))


def _missed(found: Identification) -> SquaredErrors | None:
    """The errors at held-out poses, else at the first or the last third as the others predict it.

    What drifts or warms up hides among readings of the same hours; of both ends the worse counts.
    """
    fit = fitted_of(found)
    if found.heldout is not None:
        held = found.heldout.data
        return fit.squared(held, *fit.predicted(held))
    order, (_, spread), ends = in_order(fit.data.poses), fit.predicted(fit.data), []
    for end in (order[: len(order) // 3], order[-(len(order) // 3) :]):
        member = np.isin(np.arange(len(order)), end)
        off, rows = fit.left_out(member.astype(int))
        if rows.determined[-1]:
            grown = spread[member] * np.sqrt(rows.growth[-1])
            ends.append(fit.squared(fit.data.take(member), off[member], grown))
    return max(ends, key=lambda own: own.beyond(own.noise), default=None)


@dataclass(frozen=True, eq=False)
class ForecastStep:
    """What will be known after one more pose.

    pose : str, None for what is known now; readings : int, in all
    task_rms, task_worst : float, m, expected at the targets; what is open is off by its plausible
        size, as far as the others do not make up for it
    task_most : float, m, that the error at the targets exceeds once in twenty
    from_parameters : float, m, the part of ``task_rms`` that more readings lower
    std : ndarray, shape (p,), SI, NaN for what is open
    open : tuple of str, parameters that are not determined
    """

    pose: str | None
    readings: int
    task_rms: float
    task_worst: float
    task_most: float
    from_parameters: float
    std: Array
    open: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TaskError:
    """The error that is expected at the cell's targets, as ``calib.identify`` will state it.

    rows : ndarray, shape (K, r, p), m per plausible size, of the errors at the targets; weights : (K,)
    lacking : LastingError, the error there that no reading lowers
    dof : float, degrees of freedom behind the noise, infinite where it is known
    """

    model: Model
    rows: Array
    weights: Array
    lacking: LastingError
    dof: float

    @classmethod
    def at(cls, at: Linearisation, lacking: LastingError, found: Identification | None) -> Self:
        """At the targets of a cell; found : of the data so far, None where there is none.

        What is taken for noise is known by as many degrees of freedom as the identification says.
        Where poses err as a whole they count, not points: which variances they show is chosen as well.
        """
        model, dof = at.model, np.inf
        if found is not None:
            stated = found.levels is not None and not found.levels.estimated
            as_a_whole = bool(lacking.rms) and not stated
            dof = freedom(found.noise.dof, found.stays, found.rank, as_a_whole=as_a_whole)
        targets, weights = targets_of(at.cell)
        rows = target_rows(model, at.values, targets) * model.sizes
        return cls(model, rows, weights / weights.sum(), lacking, dof)

    @property
    def weighed(self) -> Array:
        """Rows (n, p) of which the squares add up to the mean squared error."""
        return stacked(self.rows * np.sqrt(self.weights)[:, None, None])

    def expected(self, pose: str | None, readings: int, known: LinearProblem) -> ForecastStep:
        """What is known by all readings by then."""
        rows, weights, sizes = self.rows, self.weights, self.model.sizes
        p, J = len(sizes), known.fitted[1] * sizes
        ids = tuple(parameter.id for parameter in self.model.parameters)
        choice = identifiable(J, np.ones(p), ids)
        closed = np.isin(np.arange(p), choice.kept)
        span = np.eye(p)[:, choice.kept]
        cov = replace(known, span=sizes[:, None] * span).covariance / np.outer(sizes, sizes)
        cov = cov + ignorance(J, span, np.ones(p), ~closed)
        squared = np.maximum(((rows @ cov) * rows).sum(axis=(1, 2)), 0.0)
        rms, worst = task_error(np.hypot(np.sqrt(squared), self.lacking.at_targets), weights)
        most = float(np.hypot(rms, self.lacking.hidden)) * self._margin(cov, rms)
        return ForecastStep(
            pose,
            readings,
            rms,
            worst,
            most if pose else max(most, self.lacking.missed),
            task_error(np.sqrt(squared), weights)[0],
            np.where(closed, np.sqrt(np.maximum(np.diag(cov), 0.0)) * sizes, np.nan),
            tuple(name for entry in choice.unidentifiable for name in entry.names),
        )

    def _margin(self, cov: Array, rms: float) -> float:
        """By how much the error exceeds its expectation once in twenty.

        One draw of the parameters errs by ``sum lambda_i z_i^2``, a chi-square by its first two moments
        (Welch and Satterthwaite); the noise behind the expectation is an estimate as well. Their ratio
        has an F distribution.
        """
        from scipy.special import fdtri

        spread = cov @ self.weighed.T @ self.weighed
        squares = float((spread * spread.T).sum())
        drawn = rms**4 / squares if squares > 0.0 else _MANY  # nothing is open: nothing exceeds it
        return float(np.sqrt(fdtri(min(drawn, _MANY), min(self.dof, _MANY), _SURE)))


def most_useful_first(targets: Array, known: Array, rows: Array, sizes: Array) -> list[int]:
    """The n poses, each the one that lowers the error at the targets most after those before.

    targets : ndarray, shape (k, p), rows of the errors, per plausible size; sizes : ndarray, shape (p,)
    known : ndarray, shape (N, p), independent rows of what is known, per SI unit
    rows : ndarray, shape (n, r, p), those of each pose
    """
    from scipy.linalg import solve_triangular

    p = len(sizes)
    root = triangle(np.concatenate([known * sizes, np.eye(p) / _FREE]))
    T = solve_triangular(root, np.eye(p))  # in which the information now is the identity
    J = rows * sizes @ T
    blocks = Blocks(pack(np.swapaxes(J, 1, 2) @ J), np.eye(p), min(rows.shape[1:]))
    task = Task.of_rows(targets @ T)
    return list(map(int, greedy(Selection(task, blocks, Allowed.any_of(len(rows), len(rows))))))
