"""The error at the targets: what is expected of the estimate after each pose, and what none lowers.

No reading lowers the arm's scatter nor what the model lacks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from calib.arrays import Array, stacked
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.identification import Identification
from calib.inference.coverage import freedom
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import identifiable, ignorance, task_error
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of, fitted_of
from calib.scatter import Variances
from calib.solver import triangle
from doe.criteria.trace import Task
from doe.forecast.unseen import PredictionError, at_ends, at_held_out
from doe.information import Linearisation, TargetErrors
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.search import greedy

_PART = 0.5  # of what the model seems to lack, that must be more than chance
_SURE = 0.95
_MANY = 1e6  # degrees of freedom: known
_FREE = 10.0  # plausible sizes to which what is open counts as known


@dataclass(frozen=True, eq=False)
class LastingError:
    """The error at the targets that does not average away, RMS, m.

    scatter : the arm errs anew at every target; what the data do not tell from the model's error counts
        here
    unfollowed : what the model does not follow from pose to pose; discrepancy : what it lacks beside it
    seen : the error at poses that the fit was without, zero where there are none
    scatter_of : whose the scatter is: the arm's, unless the data leave that open
    surely : whether what the model lacks, or half of it, is more than chance
    at_targets : ndarray, shape (targets,), m, all of it
    hidden : scatter that the data neither show nor rule out, for which a bound allows beside all that
    trend : the part of the discrepancy by which the day's trend goes on
    after : s after the last reading at which the arm comes to the targets; None where nobody says it
    """

    scatter: float
    unfollowed: float
    discrepancy: ModelDiscrepancy
    seen: PredictionError
    scatter_of: Literal["arm", "undecided"]
    surely: bool
    at_targets: Array
    hidden: float = 0.0
    trend: float = 0.0
    after: float | None = None

    @property
    def of_model(self) -> float:
        """What the model lacks."""
        return float(np.hypot(self.unfollowed, self.discrepancy.rms))

    @property
    def rms(self) -> float:
        """All of it."""
        return float(np.hypot(self.scatter, self.of_model))


def lasting_error(
    cell: Cell, model: Model, values: Array, arm: Variances, found: Identification | None
) -> LastingError:
    """What does not average away at the cell's targets.

    model, values, arm : of the whole day; found : of the data so far, None where there is none yet
    Where something is lacking, it is as much as poses miss by that the fit was without.
    """
    targets, weights = targets_of(cell)
    none = ModelDiscrepancy(0.0, "")
    unknown = np.zeros((len(values), len(values)))
    at = Estimate(
        model, values, unknown, 0.0, none, (), variances=arm, configuration_of="instrument"
    )

    def rms(errors: Array) -> float:
        return task_error(errors, weights)[0]

    rest, seen, trend = none, PredictionError(), 0.0
    if found is not None:
        known = estimate_of(found, cell.design.targets_after or 0.0)
        at, rest = replace(at, configuration_of=known.configuration_of), known.discrepancy
        trend = rms(ExpectedError(known, targets).trend)
        rest = replace(rest, rms=float(np.hypot(rest.rms, trend)))
        seen = _seen(found)
    error = ExpectedError(at, targets)  # of the arm, and of the model from pose to pose
    scatter, lacks = rms(np.hypot(error.arm, error.model)), rms(error.model)
    sure = float(np.hypot(lacks, rest.rms))
    if seen.source and (scatter or rest.rms):
        beyond = float(np.sqrt(max(0.0, seen.lacking**2 - scatter**2)))
        rest = max(rest, ModelDiscrepancy(beyond, seen.source), key=lambda one: one.rms)
    part = _PART * float(np.hypot(lacks, rest.rms))
    lacking = LastingError(
        rms(error.arm),
        lacks,
        rest,
        seen,
        "undecided" if at.configuration_of == "undecided" else "arm",
        seen.discrepancy > 0.0 or (sure > 0.0 and sure >= part),
        np.sqrt(error.arm**2 + error.model**2 + rest.rms**2),
        trend=trend,
        after=None if found is None else cell.design.targets_after,
    )
    if found is None:
        return lacking
    unseen = None if found.undetected is None else found.undetected[1].variances
    hidden = rms(ExpectedError(replace(at, variances=unseen, configuration_of="arm"), targets).arm)
    return replace(lacking, hidden=hidden if lacking.rms else max(hidden, seen.certain))


def _seen(found: Identification) -> PredictionError:
    """The error at poses that the fit was without, m: held-out ones, else the ends of the day."""
    fit, held = fitted_of(found), found.heldout
    if held is not None and held.data.seen.any():
        return at_held_out(fit, held.data).times(found.footprint)
    return (at_ends(fit) or PredictionError()).times(found.footprint)


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

    targets : TargetErrors, per plausible size
    lacking : LastingError, the error there that no reading lowers
    dof : float, degrees of freedom behind the noise, infinite where it is known
    """

    model: Model
    targets: TargetErrors
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
        targets = TargetErrors.of(model, at.values, *targets_of(at.cell)).per(model.sizes)
        return cls(model, targets, lacking, dof)

    def expected(self, pose: str | None, readings: int, known: LinearProblem) -> ForecastStep:
        """What is known by all readings by then."""
        rows, weights, sizes = self.targets.rows, self.targets.weights, self.model.sizes
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
            most if pose else max(most, self.lacking.seen.rms),
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

        half = stacked(self.targets.rows * np.sqrt(self.targets.weights)[:, None, None])
        spread = cov @ half.T @ half
        squares = float((spread * spread.T).sum())
        drawn = rms**4 / squares if squares > 0.0 else _MANY  # nothing is open: nothing exceeds it
        return float(np.sqrt(fdtri(min(drawn, _MANY), min(self.dof, _MANY), _SURE)))


def most_useful_first(targets: TargetErrors, known: Array, rows: Array, sizes: Array) -> list[int]:
    """The n poses, each the one that lowers the error at the targets most after those before.

    targets : TargetErrors, per plausible size; sizes : ndarray, shape (p,), SI
    known : ndarray, shape (N, p), independent rows of what is known, per SI unit
    rows : ndarray, shape (n, r, p), those of each pose
    """
    from scipy.linalg import solve_triangular

    p, weights = len(sizes), np.sqrt(targets.weights)[:, None, None]
    root = triangle(np.concatenate([known * sizes, np.eye(p) / _FREE]))
    T = solve_triangular(root, np.eye(p))  # in which the information now is the identity
    J = rows * sizes @ T
    blocks = Blocks(pack(np.swapaxes(J, 1, 2) @ J), np.eye(p), min(rows.shape[1:]))
    task = Task.of_rows(stacked(targets.rows * weights) @ T)
    return list(map(int, greedy(Selection(task, blocks, Allowed.any_of(len(rows), len(rows))))))
