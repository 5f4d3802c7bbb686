"""What is expected of the estimate after each further pose, as ``calib.identify`` will say it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell.targets import targets_of
from calib.identification import Identification
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import covariance, identifiable, ignorance, task_error
from calib.poses import Measurements
from calib.scatter import Variances
from calib.uncertainty.expanded import freedom
from doe.ahead.error_floor import ErrorFloor
from doe.criteria import Criterion
from doe.criteria.trace import Task
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.exchange import greedy
from doe.problem.linearisation import Linearisation, moved_rows
from doe.problem.target_errors import TargetErrors

_SURE = 0.95
_MANY = 1e6  # degrees of freedom: known
_ROUNDING = 1e-12  # of the largest information, below which a smaller one is lost
_OPEN = 0.05**2  # information of a direction that is as uncertain as twenty plausible sizes


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """What readings tell: the normal equations of least squares, and the noise in them.

    root : ndarray, shape (p, p), R with ``R^T R`` the sum of the rows' squares
    core : ndarray, shape (p, p), covariance of the equations' right side; None for independent rows of
        unit variance, where it is ``R^T R``
    crossed : ndarray, shape (p, b), what errors common to all readings put there
    """

    root: Array
    core: Array | None
    crossed: Array

    def combined(self, other: NormalEquations) -> NormalEquations:
        """Both, of other configurations."""
        both = root(np.concatenate([self.root, other.root]))
        crossed = self.crossed + other.crossed
        if self.core is None or other.core is None:
            return NormalEquations(both, None, crossed)
        return NormalEquations(both, self.core + other.core, crossed)

    def covariance(self, span: Array) -> Array:
        """Of the least-squares values along ``span`` (p, k), shape (p, p)."""
        bread = covariance(self.root, span)
        return bread if self.core is None else np.asarray(bread @ self.core @ bread)

    def response(self, span: Array) -> Array:
        """Of those values to one standard uncertainty of each common error, shape (p, b)."""
        return np.asarray(covariance(self.root, span) @ self.crossed)


@dataclass(frozen=True, eq=False)
class ForecastStep:
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
    """Predicts how accurate the estimate is at the cell's targets after further poses.

    targets : TargetErrors, per plausible size
    lacking : ErrorFloor, the error there that no reading lowers
    dof : float, degrees of freedom behind the noise, infinite where it is known
    """

    model: Model
    targets: TargetErrors
    lacking: ErrorFloor
    dof: float

    @classmethod
    def at(cls, at: Linearisation, lacking: ErrorFloor, found: Identification | None) -> Forecast:
        """At the targets of a cell; found : of the data so far, None where there is none.

        What is taken for noise is known by as many degrees of freedom as the identification says.
        Where poses err as a whole they count, not points: which variances they show is chosen as well.
        """
        model, dof = at.model, np.inf
        if found is not None:
            told = found.levels is not None and not len(found.levels.free)
            as_a_whole = bool(lacking.rms) and not told
            dof = freedom(found.noise.dof, found.stays, found.rank, as_a_whole=as_a_whole)
        targets = TargetErrors.of(model, at.values, *targets_of(at.cell)).per(model.sizes)
        return cls(model, targets, lacking, dof)

    @property
    def criterion(self) -> Criterion:
        """The expected error at the targets, for information in plausible sizes."""
        return Task.at_targets(self.targets.rows, self.targets.weights)

    def steps(
        self,
        known: NormalEquations,
        readings: int,
        further: Iterable[tuple[str, int, NormalEquations]],
    ) -> Iterator[ForecastStep]:
        """What is known now, then with each further pose: its name, the readings it adds, and all that
        is told by then.

        Rows are in standard deviations per plausible size.
        """
        now = self._step("", readings, known)
        yield replace(now, task_most=max(now.task_most, self.lacking.seen.rms))
        for name, count, told in further:
            readings += count
            yield self._step(name, readings, told)

    def _step(self, pose: str, readings: int, told: NormalEquations) -> ForecastStep:
        rows, weights = self.targets.rows, self.targets.weights
        p = rows.shape[-1]
        ids = tuple(parameter.id for parameter in self.model.parameters)
        choice = identifiable(told.root, np.ones(p), ids)
        known = np.zeros(p, dtype=bool)
        known[choice.kept] = True
        span = np.eye(p)[:, choice.kept]
        cov = told.covariance(span) + ignorance(told.root, span, np.ones(p), ~known)
        squared = ((rows @ cov) * rows).sum(axis=(1, 2))
        own = np.sqrt(np.maximum(squared, 0.0))
        parameters = task_error(own, weights)[0]
        response = told.response(span)
        missed = self.targets.missed(response)
        common = np.sqrt((missed**2).sum(axis=(1, 2)))
        combined = np.hypot(common, self.lacking.at_targets)
        rms, worst = task_error(np.hypot(own, combined), weights)
        variances = np.maximum(np.diag(cov), 0.0) + (response**2).sum(axis=1)
        std = np.where(known, np.sqrt(variances) * self.model.sizes, np.nan)
        lost = tuple(name for entry in choice.unidentifiable for name in entry.names)
        doubted = np.hypot(rms, self.lacking.hidden)
        most = float(doubted) * self._margin(cov, missed, rms)
        by_common = task_error(common, weights)[0]
        return ForecastStep(pose, readings, rms, worst, most, parameters, std, lost, by_common)

    def _margin(self, cov: Array, missed: Array, rms: float) -> float:
        """By how much the error exceeds its expectation once in twenty.

        One draw of the parameters and of the common errors, ``missed`` (targets, r, b) by one standard
        uncertainty of each, errs by ``sum lambda_i z_i^2``, a chi-square by its first two moments
        (Welch and Satterthwaite); the noise behind the expectation is an estimate as well. Their ratio
        has an F distribution.
        """
        from scipy.special import fdtri

        share = np.sqrt(self.targets.weights)[:, None, None]
        half, shared = (self.targets.rows * share).reshape(-1, len(cov)), missed * share
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


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings to first order, per plausible size of the parameters.

    rows, common : LinearProblem, the latter how the same readings follow errors common to all
    """

    rows: LinearProblem
    common: LinearProblem

    @classmethod
    def at(cls, at: Linearisation, data: Measurements, kept: Mask | None = None) -> Readings:
        """Of a data set, of which some readings count, shape (m,)."""
        rows = at.of(data, kept)
        arm = Variances.of_arm(at.model.robot.dof, at.cell.repeatability)
        # The estimate weighs whole poses as the cell says that the arm scatters.
        weighing = replace(at, arm=arm).of(data, kept).mixing if arm.any else None
        rows = LinearProblem.of_rows(rows.J * at.model.sizes, rows.mixing)
        common = moved_rows(at, data, at.weights(data, kept), rows)
        return cls(replace(rows, weighing=weighing, held=np.zeros((0, len(at.values)))), common)

    def with_prior(self, held: Array, pull: float) -> Readings:
        """The same where rows ``held`` (k, p) are known, which weigh ``pull`` times more."""
        return replace(self, rows=replace(self.rows, off=np.zeros(len(held)), held=held, pull=pull))

    def equations(self, chosen: Mask | None = None) -> NormalEquations:
        """What they tell together, all or some of them, (m,), and what is known beside them."""
        own = self.rows.J if chosen is None else self.rows.J * chosen[:, None, None]
        counted, pull = own, self.rows.pull
        if self.rows.weighing is not None:
            counted = self.rows.weighing(own)
            own = self.rows.weighing.back(counted)
        held = pull * self.rows.held
        core = None
        if self.rows.mixing is not None:  # the error of what is held weighs more as well
            core = self.rows.mixing.covariance(own) + pull**2 * held.T @ held
        crossed = np.einsum("mrp,mrb->pb", own, self.common.J)
        return NormalEquations(root(np.concatenate([stacked(counted), held])), core, crossed)


def root(rows: Array) -> Array:
    """R (p, p) with ``R^T R = rows^T rows``."""
    R = np.linalg.qr(rows, mode="r")
    return np.concatenate([R, np.zeros((rows.shape[1] - len(R), rows.shape[1]))])


def regularised(blocks: Blocks) -> Blocks:
    """Candidates beside what is known, of which what nothing tells counts as twenty plausible sizes."""
    largest = max(np.abs(blocks.fixed).max(initial=0.0), np.abs(blocks.packed).max(initial=0.0))
    return blocks.plus(max(_OPEN, _ROUNDING * float(largest)) * np.eye(len(blocks.fixed)))


def best_next(criterion: Criterion, blocks: Blocks, count: int) -> IntArray:
    """The candidates that add most, one after the other, beside what is known already.

    What is open is closed first.
    """
    return greedy(criterion, regularised(blocks), Allowed.any_of(len(blocks), count))
