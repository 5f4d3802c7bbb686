"""What a fitted model leaves beside the noise, the arm's scatter and its parameters' uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size, stacked
from calib.identification.noise_level import refuted
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import half, working_points
from calib.noise import counted, unwhitened
from calib.observations import Points
from calib.poses import Measurements, Poses
from calib.poses.moves import in_order
from calib.scatter import Scatter, Variances, scatter_of

_ENDS = (1 / 3, 1 / 5, 1 / 10)  # of the readings; the largest that the others can do without
_SURELY = 2.33  # standard deviations: once in a hundred by chance
_NOTHING = 1e-30  # m^2: an error that rounding makes
_FREE = 1e-4  # of a row's freedom: less, and nothing but its own configuration tells of it
_ROUNDED = 1e-12  # share of a direction that is rounding


@dataclass(frozen=True)
class Unexplained:
    """3-D RMS per point [m] of what the model leaves beside noise, scatter and its uncertainty.

    source : "held-out poses", every one of them, those that stand out too: nothing shows that targets
        are better; else "left-out configurations" of the fitted poses, less the outliers
    """

    rms: float
    source: str


@dataclass(frozen=True)
class Unseen:
    """What poses showed that the fit was without, 3-D RMS per point, m.

    rms : less the instrument's noise; lacking : less what the parameters' uncertainty adds there, too
    unexplained : less the arm's scatter, too, zero where that may be chance; source : str, which poses
    certain : ``lacking``; where that may be chance, by the readings that the parameters leave certain
    """

    rms: float
    lacking: float
    unexplained: float
    source: str
    certain: float = 0.0

    def times(self, factor: float) -> Unseen:
        """The same figures in another unit of length."""
        lengths = {
            field.name: factor * getattr(self, field.name)
            for field in fields(self)
            if field.name != "source"
        }
        return replace(self, **lengths)


@dataclass(frozen=True, eq=False)
class Fitted:
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

    @cached_property
    def scatter(self) -> Scatter | None:
        """How the arm scatters at the poses that were fitted; None where it does not."""
        if self.variances is None or not self.variances.any:
            return None
        return scatter_of(self.model, self.values, self.data.poses, self.variances)

    @cached_property
    def linear(self) -> LinearProblem:
        """The fit to first order, by the readings alone."""
        points = Points(self.model, self.data, self.weights, scatter=self.scatter)
        return LinearProblem(*points.whitened(self.values), self.span, mixing=points.mixing)

    @property
    def by_instrument(self) -> LinearProblem:
        """The linear problem without the arm's scatter: rows err by the instrument alone."""
        return replace(self.linear, mixing=None)

    @property
    def lengths(self) -> Mask:
        """Which numbers of the readings are lengths, shape (C, r)."""
        return self.model.readout.channels.lengths

    def scattered(self, data: Measurements) -> Array:
        """Variance that the arm's scatter adds to each point, shape (m, M), m^2."""
        return _scatter(self.model, self.values, data.poses, self.variances)

    def told(self, data: Measurements) -> Mask:
        """Readings of a data set that hold a length, shape (m, C): of several instruments some do."""
        return np.asarray(data.seen & self.lengths.any(axis=-1))


def scatter_at(model: Model, values: Array, poses: Poses, variances: Variances | None) -> Array:
    """Squared error (m, M) [m^2] that the arm's scatter adds where it is approached anew."""
    return _scatter(working_points(model), values, poses, variances)


def _scatter(model: Model, values: Array, poses: Poses, variances: Variances | None) -> Array:
    """The same at what the model reads."""
    if variances is None or not variances.any:
        return np.zeros((len(poses), len(model.readout.channels.lengths)))
    total = variances.approach + variances.configuration
    return scatter_of(model, values, poses, variances).point_variance(total)


def left_in_fit(fit: Fitted) -> Unexplained:
    """``u^2 = rms^2 - s^2 - 3 sigma^2 - scatter^2`` at configurations that are left out in turn.

    A fit bends towards its own poses, and hides what a pose beside them will show. None where the
    residual agrees with the noise, or, where the arm scatters, the left-out ones agree with that.
    """
    if not fit.sigma:  # without noise nothing is beyond it
        return Unexplained(0.0, "left-out configurations")
    error, share = _shares(fit, fit.data)
    vectors, growth, known = left_out(fit)
    seen = fit.told(fit.data) & known[:, None]
    if not seen.any():
        return Unexplained(0.0, "left-out configurations")
    there = (vectors**2 * fit.lengths).sum(axis=-1)
    expected = _noise(fit) + fit.scattered(fit.data) + share * growth[:, None]
    excess = float((there - expected)[seen].mean())
    if fit.variances is not None and fit.variances.any:
        surely = _beyond(there, expected, seen, fit.data.poses.configuration)
    else:
        rows = int((counted(fit.weights) > 0).astype(int).sum(axis=0) @ fit.lengths.sum(axis=-1))
        share_of = rows / max(int(counted(fit.weights).sum()), 1)
        surely = refuted(
            float(error.sum()) / fit.sigma**2, rows - round(share_of * fit.span.shape[1])
        )
    return Unexplained(float(np.sqrt(excess)) if surely and excess > 0.0 else 0.0,
                       "left-out configurations")  # fmt: skip


def unexplained(fit: Fitted, heldout: Measurements | None, footprint: float) -> Unexplained:
    """What the model lacks: by poses that the parameters never saw, else by left-out configurations.

    footprint : metres to one unit of the readings, as of :meth:`calib.model.Model.footprint`
    """
    if heldout is None or not heldout.seen.any():
        rest = left_in_fit(fit)
    else:
        shown = at_held_out(fit, heldout)
        rest = Unexplained(shown.unexplained, shown.source)
    return replace(rest, rms=rest.rms * footprint)


def at_held_out(fit: Fitted, heldout: Measurements) -> Unseen:
    """What poses show that the parameters never saw, at least one point of them seen."""
    points, J = fit.model.jacobian(fit.values, heldout.poses)
    off = heldout.readings - points
    return _unseen(fit, heldout, off, J @ half(fit.covariance), "held-out poses")


def at_ends(fit: Fitted) -> Unseen | None:
    """What the first and the last readings show, each of them by a fit to all the others.

    What drifts or warms up hides among readings of the same hours, and fresh poses come later. None
    where the others do not determine the model. With Q an orthonormal basis of the fitted columns, the
    readings F that are left out miss by ``r_F + Q_F (I - Q_F^T Q_F)^-1 Q_F^T r_F``. The worse end
    counts.
    """
    r, Q = fit.by_instrument.complement.at_readings
    order, found = in_order(fit.data.poses), []
    for way in (order, order[::-1]):
        parts = (np.sort(way[: round(part * len(way))]) for part in _ENDS)
        shown = (_without(fit, end, r[end], Q[end]) for end in parts if len(end))
        found += [one for one in shown if one is not None][:1]
    return max(found, key=lambda one: one.lacking, default=None)


def _without(fit: Fitted, end: IntArray, r: Array, Q: Array) -> Unseen | None:
    """What some readings show by a fit to the others; None where those do not determine the model.

    r, Q : ndarray, shape (n, R) and (n, R, k), of these readings
    """
    F = stacked(Q)
    rest = np.eye(F.shape[-1]) - F.T @ F
    if np.linalg.eigvalsh(rest).min(initial=1.0) < _FREE:
        return None
    grown = np.linalg.solve(np.linalg.cholesky(rest), F.T).T
    missed = r.ravel() + grown @ (grown.T @ r.ravel())
    data, W = fit.data.take(end), fit.weights[end]
    off, *moved = (unwhitened(W, fit.data.in_place(v, end)) for v in (missed, *grown.T))
    spread, told = np.stack(moved, axis=-1), _told(fit, data)
    # As uncertain as the parameters are, which may follow poses that err as a whole.
    growth = float((grown**2).sum()) / max(float((F**2).sum()), 1e-300)
    share = growth * float(_shares(fit, data)[1][fit.told(data)].sum())
    own = float((spread[told] ** 2).sum())
    spread = spread * np.sqrt(share / max(own, 1e-300))
    return _score_tested(fit, data, off, spread)


def _score_tested(fit: Fitted, data: Measurements, off: Array, spread: Array) -> Unseen:
    """What a fit missed at readings it was without, and by a score test whether that may be chance.

    off : ndarray, shape (m, C, r), m; spread : ndarray, shape (m, C, r, k), how the parameters move
    them. Where the parameters are uncertain tells little. Points of a pose err together: one counts.
    """
    shown = _unseen(fit, data, off, spread, "the ends of the day")
    told, seen = _told(fit, data), fit.told(data)
    if not (fit.sigma and seen.any()):
        return shown
    scatter = fit.scattered(data)
    each = np.sqrt(fit.sigma**2 + scatter / np.maximum(told.sum(axis=-1), 1))[..., None] * told
    _, chance = _excess(
        off[told] / each[told],
        spread[told] / each[told][:, None],
        1.0,
        together=float(seen.sum() / max(seen.any(axis=1).sum(), 1)) if scatter.any() else 1.0,
    )
    beyond = shown.certain**2 - float(scatter[seen].mean())
    return replace(
        shown,
        lacking=shown.certain,
        unexplained=0.0 if chance else float(np.sqrt(max(0.0, beyond))),
    )


def left_out(fit: Fitted) -> tuple[Array, Array, Mask]:
    """Errors at each configuration by what the others say, to first order, without a refit.

    With Q an orthonormal basis of the fitted columns, rows F that are left out miss by
    ``(I - Q_F Q_F^T)^-1 r_F``. Returns these errors (m, C, r); by how much more the parameters'
    uncertainty counts there, (m,); and whether the others tell of the configuration at all, (m,).
    """
    r, Q = fit.by_instrument.complement.at_readings
    m, R = r.shape
    errors, growth, known = np.zeros((m, R)), np.ones(m), np.zeros(m, dtype=bool)
    for index in by_size(fit.data.poses.configuration):
        B, c = index.shape
        axes, held = _directions(Q[index].reshape(B, c * R, Q.shape[-1]))
        known[index] = (1.0 - held.max(axis=-1, initial=0.0) > _FREE)[:, None]
        gained = 1.0 / np.maximum(1.0 - held, _FREE) - 1.0
        off = r[index].reshape(B, -1, 1)
        off = off + axes @ (gained[..., None] * (np.swapaxes(axes, -1, -2) @ off))
        errors[index] = off.reshape(*index.shape, R)
        inside = np.maximum(held.sum(axis=-1), 1e-300)
        growth[index] = (gained.sum(axis=-1) / inside)[:, None]
    return unwhitened(fit.weights, fit.data.in_place(errors)), growth, known


def _directions(F: Array) -> tuple[Array, Array]:
    """Axes (B, n, l) and eigenvalues (B, l) of ``F F^T``, F (B, n, k), by its smaller product."""
    if F.shape[-2] <= F.shape[-1]:
        squares, axes = np.linalg.eigh(F @ np.swapaxes(F, -1, -2))
        return axes, squares
    squares, turn = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)
    seen = squares > _ROUNDED  # what no row of these tells leaves nothing to take off
    return F @ turn * np.where(seen, 1.0 / np.sqrt(np.where(seen, squares, 1.0)), 0.0)[
        :, None
    ], squares


def _told(fit: Fitted, data: Measurements) -> Mask:
    """Which numbers of a data set are lengths that were read, shape (m, C, r)."""
    return np.asarray(data.seen[..., None] & fit.lengths)


def _unseen(fit: Fitted, data: Measurements, off: Array, spread: Array, source: str) -> Unseen:
    """From errors (m, C, r) where the fit was without.

    spread : ndarray, shape (m, C, r, k), how the parameters move these readings
    """
    seen, told = fit.told(data), _told(fit, data)
    error = (off**2 * told).sum(axis=-1)
    share = (spread**2 * told[..., None]).sum(axis=(-1, -2))
    expected = np.maximum(_noise(fit) + share + fit.scattered(data), _NOTHING)
    if not seen.any():
        return Unseen(0.0, 0.0, 0.0, source)
    noise = np.broadcast_to(_noise(fit), seen.shape)
    rms, lacking, excess = (
        float(max(0.0, (error - known)[seen].mean())) for known in (noise, noise + share, expected)
    )
    certain, chance = _excess(off[told], spread[told], fit.sigma)
    certain = max(0.0, certain * float(told.sum() / seen.sum())) if chance else lacking
    if fit.variances is not None and fit.variances.any:
        surely = _beyond(error, expected, seen, data.poses.configuration)
    else:
        numbers = np.broadcast_to(fit.lengths.sum(axis=-1), seen.shape)[seen]
        surely = refuted(float((numbers * error[seen] / expected[seen]).sum()), int(numbers.sum()))
    rms, lacking, excess, certain = np.sqrt([rms, lacking, excess * surely, certain]).tolist()
    return Unseen(rms, lacking, excess, source, certain)


def _excess(off: Array, spread: Array, sigma: float, together: float = 1.0) -> tuple[float, bool]:
    """Variance of errors (n,) beyond ``V = sigma^2 I + spread spread^T``, and whether it may be chance.

    spread : ndarray, shape (n, k). One step of Fisher's scoring from none, and its score test: what
    the parameters leave uncertain counts little. together : so many errors are one
    """
    if not sigma:
        return float((off**2).mean()), False
    U, s, _ = np.linalg.svd(spread, full_matrices=False)
    own, v = (U.T @ off) ** 2, sigma**2 + s**2
    others, rest = len(off) - len(s), float(off @ off - own.sum())
    top = ((own - v) / v**2).sum() + (rest - others * sigma**2) / sigma**4
    bottom = (1.0 / v**2).sum() + others / sigma**4
    return float(top / bottom), bool(top < _SURELY * np.sqrt(2.0 * bottom * together))


def _shares(fit: Fitted, data: Measurements) -> tuple[Array, Array]:
    """Squared error of every point (m, M), and what the parameters' uncertainty adds to it, m^2."""
    points, J = fit.model.jacobian(fit.values, data.poses)
    off = data.readings - points
    error = (off**2 * fit.lengths).sum(axis=-1) * data.seen
    J = J * fit.lengths[..., None]
    return error, np.einsum("mjip,pq,mjiq->mj", J, fit.covariance, J, optimize=True)


def _noise(fit: Fitted) -> Array:
    """What the instrument adds to each reading (C,), m^2: ``3 sigma^2`` to a point."""
    return np.asarray(fit.lengths.sum(axis=-1) * fit.sigma**2)


def _beyond(error: Array, expected: Array, seen: Mask, configuration: IntArray) -> bool:
    """Whether errors exceed what is expected where the points of a configuration err together."""
    each = np.where(seen, error / np.where(seen, expected, 1.0), 0.0).sum(axis=1)
    counts = np.bincount(configuration, seen.sum(axis=1))
    ratios = np.bincount(configuration, each)[counts > 0] / counts[counts > 0]
    return refuted(3.0 * float(ratios.sum()), 3 * len(ratios)) and float(ratios.mean()) > 1.0
