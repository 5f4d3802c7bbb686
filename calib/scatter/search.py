"""Which variances the data show: they enter one after the other, each if it pays for itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Repeatability
from calib.scatter.poses import Scatter, Variances
from calib.scatter.restricted import Likelihood, MixedModel, likelihood, maximised, mixed_model

if TYPE_CHECKING:
    from calib.linear import LinearProblem

_PAYS = 6.0  # fall of -2 log likelihood; half a chi-square at the bound: once in seventy by chance
_TRIED = 2  # of the most, or the least, promising
_BEYOND_DOUBT = 1000.0  # fall that each must promise of several that enter together
_SURELY = 10.0  # times its price: a variance that is worth so much by a quadratic model stays
_FEWEST = 10  # rows that see the instrument alone, from which on it can be told from the arm


@dataclass(frozen=True, eq=False)
class Undetected:
    """Scatter of an arm that the readings do not show, as far as they allow it.

    variances : Variances; freedom : float, degrees of freedom of what the arm adds, one at least
    """

    variances: Variances
    freedom: float


@dataclass(frozen=True, eq=False)
class VarianceEstimate:
    """Variance components of instrument, approaches and configurations.

    variances : Variances
    free : ndarray of int, which of the problem's variances were estimated; theta : their values, all of
        them, shape (v,), in its units
    value : float, -2 log likelihood; alone : float, with nothing but what was known beforehand
    instrument_rows : int, that nothing but the instrument moves
    approaches : bool, whether configurations were approached again: then ``approach`` is the arm's
        repeatability, else that counts with ``configuration``
    undetected : scatter of the arm that does not show; None where it shows, or is stated
    """

    variances: Variances
    free: IntArray
    theta: Array
    value: float
    alone: float
    instrument_rows: int
    approaches: bool
    undetected: Undetected | None = None

    @property
    def instrument_seen(self) -> bool:
        """Whether the data tell the instrument's noise from the arm's."""
        return self.instrument_rows >= _FEWEST

    @property
    def instrument_only(self) -> bool:
        """Whether the readings say that the instrument, and nothing else, errs more than it should."""
        return self.instrument_seen and self.free.tolist() == [0]


def problem_of(
    scatter: Scatter, levers: Array, linear: LinearProblem, known: Repeatability | None = None
) -> MixedModel:
    """The linear problem of readings, with what of the variances is known beforehand.

    levers : ndarray, shape (m, R, n + 6), whitened as the rows of the problem are
    known : the arm's repeatability where the cell says it; None to be estimated
    """
    F = np.empty((*linear.r.shape, linear.span.shape[1] + 1))
    np.matmul(linear.J, linear.span, out=F[..., :-1])
    F[..., -1] = linear.r
    held = np.zeros((0, F.shape[-1]))
    if len(linear.off):
        held = np.column_stack([linear.held @ linear.span, linear.off])
    problem = mixed_model(scatter, levers, F, held, F.shape[-1] - 1, known is not None)
    start = np.zeros(len(problem.units))
    start[0] = 1.0
    free = np.arange(len(start))
    if known is not None:
        own = Variances.of_arm(scatter.joints, known).approach
        start[1 : 1 + len(own)] = own / problem.units[1 : 1 + len(own)]
        free = np.delete(free, np.arange(1, 1 + len(own)))
    return replace(problem, start=start, may=free)


def levels_of(
    scatter: Scatter,
    levers: Array,
    linear: LinearProblem,
    known: Repeatability | None = None,
    before: VarianceEstimate | None = None,
) -> VarianceEstimate:
    """Estimate the levels by restricted likelihood; arguments as of :func:`problem_of`.

    before : an earlier estimate, from which the search goes on
    Variances enter where they pay, and leave where they no longer do; the first to enter pays for the
    choice among all as well.
    """
    return searched(problem_of(scatter, levers, linear, known), scatter, before)


def searched(
    problem: MixedModel, scatter: Scatter, before: VarianceEstimate | None = None
) -> VarianceEstimate:
    """The levels of a problem."""
    theta, free = problem.start, np.zeros(0, dtype=int)
    found = nothing = likelihood(problem, theta)
    if before is not None and len(before.free):
        theta = np.maximum(before.theta, problem.start * (before.theta == 0.0))
        free = before.free
        theta, found = maximised(problem, theta, free)
    state = theta, found, free
    while (more := _entering(problem, *state)) is not None:
        state = more
    while (less := _leaving(problem, *state)) is not None:
        state = less
    if scatter.has_approaches:
        state = _moved(problem, *state, scatter.joints + 2)
    theta, found, free = state
    if found.value > nothing.value - _entry_price(len(problem.may)):
        theta, found, free = problem.start, nothing, np.zeros(0, dtype=int)
    count, own = scatter.joints + 2, theta * problem.units
    approach = own[1 : 1 + count] if len(own) > 1 + count else np.zeros(count)
    return VarianceEstimate(
        Variances(float(np.sqrt(own[0])), approach, own[-count:]),
        free,
        theta,
        found.value,
        nothing.value,
        problem.beyond_rigid,
        scatter.has_approaches,
    )


State = tuple[Array, Likelihood, IntArray]


def _entry_price(choices: int) -> float:
    return _PAYS + 2.0 * float(np.log(choices))


def _entering(problem: MixedModel, theta: Array, found: Likelihood, free: IntArray) -> State | None:
    """The search with more variances free: all that pay beyond doubt, or one; None where none pays."""
    may = problem.may
    price = _PAYS if len(free) else _entry_price(len(may))
    promised = np.zeros(len(theta))
    promised[may] = _promises(found, free)[may]
    # Two that promise the same are one and the same, as of a single point on the tip: the first stands.
    rounded = promised.round(6 - int(np.log10(promised.max() + 1.0)))
    order = np.unique(-rounded, return_index=True)[1]
    together = order[(promised[order] > _BEYOND_DOUBT) & (len(free) > 0)]
    for more in (together, *order[:_TRIED, None]):
        if promised[more].sum() < 0.5 * _PAYS:
            continue
        wider = np.sort(np.append(free, more))
        fresh, better = maximised(problem, theta, wider, found=found)
        if found.value - better.value > price:
            return fresh, better, wider
    return None


def _promises(found: Likelihood, free: IntArray) -> Array:
    """Fall that each variance promises beside those that are free, (v,), by a quadratic model."""
    A, g = found.information, found.gradient
    left = np.diag(A).copy()
    if len(free):
        inner = np.linalg.solve(A[np.ix_(free, free)], A[free])
        left = left - np.einsum("fv,fv->v", A[free], inner)
    falls = 0.5 * g**2 / np.maximum(left, 1e-9 * np.maximum(np.diag(A), 1e-300))
    falls[1:] = np.where((g[1:] < 0.0) & (np.diag(A)[1:] > 0.0), falls[1:], 0.0)
    falls[free] = 0.0
    return np.asarray(falls)


def _leaving(problem: MixedModel, theta: Array, found: Likelihood, free: IntArray) -> State | None:
    """One variance less, where one does not pay; that is tried of which least is expected."""
    if not len(free):
        return None
    A = found.information[np.ix_(free, free)]
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    inverse = np.linalg.pinv(A / np.outer(size, size), hermitian=True)
    worth = ((theta - problem.start)[free] * size) ** 2 / np.maximum(np.diag(inverse), 1e-12)
    for j in free[np.argsort(worth)[:_TRIED]]:
        if worth[free == j] > _SURELY * _PAYS:
            break
        without = theta.copy()
        without[j] = problem.start[j]
        rest = free[free != j]
        fresh, poorer = maximised(problem, without, rest, 0.1)
        if poorer.value - found.value < _PAYS:
            return fresh, poorer, rest
    return None


def _moved(
    problem: MixedModel, theta: Array, found: Likelihood, free: IntArray, count: int
) -> State:
    """With what scatters at each approach, or at each configuration, where it is likelier to.

    count : int, variances of each: one that came in first may stand in the place of the other
    """
    state = theta, found, free
    for j in free[free > 0]:
        theta, found, free = state
        other = j + count if j <= count else j - count
        if other in free or other not in problem.may:
            continue
        swapped = theta.copy()
        swapped[other], swapped[j] = theta[j], 0.0
        rest = np.sort(np.append(free[free != j], other))
        fresh, better = maximised(problem, swapped, rest, 0.1)
        if better.value < found.value:
            state = fresh, better, rest
    return state
