"""Model discrepancy: what a fit leaves beside noise, the arm's scatter and its parameters' uncertainty.

Readings that the fit was without show it: held-out poses, else each configuration as the others
predict it. Their mean square error is ``u^2 + noise + parameters + arm``, the last three known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.identification.noise import refuted
from calib.inference.leave_out import LeftOut, leave_groups_out
from calib.model import Model
from calib.model.covariance import half
from calib.noise import counted, unwhitened
from calib.observations import Points
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter, Variances, scatter_of, scatter_variance
from calib.poses import Measurements

_NOTHING = 1e-30  # m^2: an error that rounding makes
_FREE = 1e-4  # of a row's freedom: less, and nothing but its own configuration tells of it


@dataclass(frozen=True)
class ModelDiscrepancy:
    """3-D RMS per point, m.

    source : "held-out poses", every one of them, those that stand out too: nothing shows that targets
        are better; else "left-out configurations" of the fitted poses, less the outliers
    """

    rms: float
    source: str


@dataclass(frozen=True, eq=False)
class SquaredErrors:
    """Squared errors of readings, and what is expected of them, shape (m, C), m^2.

    numbers : ndarray of int, shape (m, C), how many numbers of a reading count
    configuration : ndarray of int, shape (m,)
    """

    error: Array
    noise: Array
    parameters: Array
    arm: Array
    numbers: IntArray
    configuration: IntArray

    @property
    def seen(self) -> Mask:
        """Readings that count, shape (m, C)."""
        return np.asarray(self.numbers > 0)

    @property
    def expected(self) -> Array:
        """All that is expected, shape (m, C), m^2."""
        return np.asarray(np.maximum(self.noise + self.parameters + self.arm, _NOTHING))

    def beyond(self, known: Array) -> float:
        """RMS of the errors beyond a variance (m, C), m; zero where nothing was read."""
        excess = (self.error - known)[self.seen]
        return float(np.sqrt(max(0.0, excess.mean()))) if len(excess) else 0.0

    @property
    def discrepancy(self) -> float:
        """RMS beyond all that is expected, m; zero where that may be chance."""
        return self.beyond(self.expected) if self.seen.any() and self.surely else 0.0

    @property
    def surely(self) -> bool:
        """Whether so large errors are none by chance; where poses err as a whole, they count once."""
        ratios = np.where(self.seen, self.error / self.expected, 0.0)
        if not self.arm.any():
            return refuted(float((self.numbers * ratios).sum()), int(self.numbers.sum()))
        counts = np.bincount(self.configuration, self.seen.sum(axis=1))
        each = np.bincount(self.configuration, ratios.sum(axis=1))[counts > 0] / counts[counts > 0]
        return refuted(3.0 * float(each.sum()), 3 * len(each)) and float(each.mean()) > 1.0


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fit, and what is known of the noise in its readings.

    covariance : ndarray, shape (p, p), SI; span : ndarray, shape (p, k), directions that were fitted
    data : Measurements, that were fitted; weights : ndarray, shape (m, C, r, r), zero for hidden ones
    sigma : float, m, of one coordinate of the instrument alone
    variances : Variances or None, of the arm's scatter
    """

    model: Model
    values: Array
    covariance: Array
    span: Array
    data: Measurements
    weights: Array
    sigma: float
    variances: Variances | None

    @property
    def lengths(self) -> Mask:
        """Which numbers of the readings are lengths, shape (C, r)."""
        return self.model.readout.channels.lengths

    @cached_property
    def scatter(self) -> Scatter:
        """How the arm scatters at the poses."""
        variances = self.variances or Variances.none(self.model.robot.dof)
        return scatter_of(self.model, self.values, self.data.poses, variances)

    @cached_property
    def points(self) -> Points:
        """Its readings, weighed by the instrument."""
        return Points(self.model, self.data, self.weights)

    @cached_property
    def linear(self) -> LinearProblem:
        """The fit to first order."""
        return self.points.linear(self.values, self.span)

    def predicted(self, data: Measurements) -> tuple[Array, Array]:
        """Errors (m, C, r) at readings, and the root of their covariance by the parameters, (.., k)."""
        points, J = self.model.jacobian(self.values, data.poses)
        return data.readings - points, J @ half(self.covariance)

    def squared(self, data: Measurements, off: Array, spread: Array) -> SquaredErrors:
        """Squares of errors (m, C, r), m, and of their roots (m, C, r, k), of all lengths read."""
        read = data.seen[..., None] & self.lengths
        error = (off**2 * read).sum(axis=-1)
        return SquaredErrors(
            error,
            np.broadcast_to(self.lengths.sum(axis=-1) * self.sigma**2, error.shape),
            ((spread**2).sum(axis=-1) * read).sum(axis=-1),
            scatter_variance(self.model, self.values, data.poses, self.variances),
            read.sum(axis=-1),
            data.poses.configuration,
        )

    def left_out(self, group: IntArray) -> tuple[Array, LeftOut]:
        """Errors (m, C, r), m, of groups (m,) of poses as the others predict them, without a refit.

        Weighed by the instrument, and beside them what :mod:`calib.inference.leave_out` says of the
        whitened rows.
        """
        r, J = self.linear.r, self.linear.J
        rows = np.repeat(group, r.shape[1])
        found = leave_groups_out(stacked(J @ self.span), r.ravel(), rows, least=_FREE)
        off = self.data.in_place(found.residual.reshape(r.shape))
        return unwhitened(self.weights, off), found


def model_discrepancy(
    fit: FittedModel, heldout: Measurements | None, metres: float
) -> ModelDiscrepancy:
    """The discrepancy of a fit, by held-out poses if there are any.

    metres : to one unit of the readings, as of :meth:`calib.model.Model.footprint`
    """
    if heldout is not None and heldout.seen.any():
        found = fit.squared(heldout, *fit.predicted(heldout))
        return ModelDiscrepancy(found.discrepancy * metres, "held-out poses")
    return ModelDiscrepancy(_at_left_out(fit) * metres, "left-out configurations")


def _at_left_out(fit: FittedModel) -> float:
    """RMS at configurations that are left out in turn, m: a fit bends towards those that it has.

    Zero where that may be chance: the residual tells it, as left-out errors follow each other by the
    parameters; where the arm scatters the left-out errors do.
    """
    if not fit.sigma:  # without noise nothing is beyond it
        return 0.0
    configuration, (residual, spread) = fit.data.poses.configuration, fit.predicted(fit.data)
    off, rows = fit.left_out(configuration)
    number = np.unique(configuration, return_inverse=True)[1]
    growth = np.sqrt(rows.growth)[number][:, None, None, None]
    found = fit.squared(fit.data, off, spread * growth)
    found = replace(found, numbers=found.numbers * rows.determined[number][:, None])
    if not (found.arm.any() or _noisy(fit, fit.squared(fit.data, residual, spread).error.sum())):
        return 0.0
    return found.discrepancy if found.arm.any() else found.beyond(found.expected)


def _noisy(fit: FittedModel, square: float) -> bool:
    """Whether the residual, a sum of squares, m^2, is more than the noise makes by chance."""
    count = counted(fit.weights)
    numbers = int((count > 0).sum(axis=0) @ fit.lengths.sum(axis=-1))
    spent = round(numbers / max(int(count.sum()), 1) * fit.span.shape[1])
    return refuted(float(square) / fit.sigma**2, numbers - spent)
