"""Covariance of the estimate, the subset that can be estimated, and the accuracy at targets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.effects.tool_base import Tool
from calib.errors import Unsolvable
from calib.instruments import Tracker
from calib.model import Model
from calib.poses import Poses
from calib.solver import condensed, triangle

_UNSEEN = 0.05  # a standard deviation of twenty plausible sizes: the data say nothing
_NUMERICAL = 1e-9  # relative to the largest column
_NAMED = 0.1
_ALL = 2.0  # times the directions, up to so many values the rows of all are condensed
_OUTSIDE = 1e-6  # length of a unit vector's part outside the span


@dataclass(frozen=True)
class Unidentifiable:
    """Parameters that the poses do not determine, by their ids, and why."""

    names: tuple[str, ...]
    reason: str


@dataclass(frozen=True, eq=False)
class Identifiable:
    """What a set of poses can determine.

    kept : ndarray of int, positions of the directions (columns of the span) that are estimated
    unidentifiable : tuple of Unidentifiable
    """

    kept: IntArray
    unidentifiable: tuple[Unidentifiable, ...]


def identifiable(J: Array, sizes: Array, ids: tuple[str, ...]) -> Identifiable:
    """Directions that the weighted rows determine better than twenty plausible sizes.

    J : ndarray, shape (N, k), in standard deviations per unit of each direction
    sizes : ndarray, shape (k,), plausible size of each direction
    ids : tuple of str, its name

    Raises Unsolvable where rows are no numbers.
    """
    from scipy.linalg import qr, solve_triangular

    if not np.isfinite(J).all():  # an arm so soft that it does not stand
        raise Unsolvable
    # The triangle first: pivots of its columns are those of the rows, and there are fewer of them.
    R, order = qr(triangle(J * sizes), mode="r", pivoting=True)
    pivots = np.abs(np.diag(R))
    rank = int((pivots > max(_UNSEEN, _NUMERICAL * pivots.max(initial=0.0))).sum())
    lost = []
    shares = (
        solve_triangular(R[:rank, :rank], R[:rank, rank:]) if rank else np.zeros((0, len(order)))
    )
    for column, position in enumerate(order[rank:]):
        share = shares[:, column]
        seen = np.linalg.norm(R[:, rank + column]) > _UNSEEN
        least = _NAMED * np.abs(share).max(initial=0.0)
        largest = np.argsort(-np.abs(share))[:4]
        named = [ids[order[i]] for i in largest if seen and abs(share[i]) > least]
        reason = (
            f"at these poses it moves the markers as {', '.join(named)} do together"
            if named
            else "no reading changes with it at these poses"
        )
        lost.append(Unidentifiable((ids[position],), reason))
    return Identifiable(np.sort(order[:rank]), tuple(lost))


def covariance(J: Array, span: Array) -> Array:
    """Covariance of all p values for independent rows of unit variance, shape (p, p).

    J : ndarray, shape (N, p); span : ndarray, shape (p, k), directions that are estimated
    """
    own = root(J, span)
    return np.asarray(own @ own.T)


def determined(span: Array) -> Mask:
    """Whether the data speak of each value by itself, shape (p,).

    span : ndarray, shape (p, k), directions that are estimated
    Where the unit vector of a value leaves the span, its entry in the covariance tells nothing.
    """
    Q, _ = np.linalg.qr(span)
    return np.asarray(1.0 - (Q**2).sum(axis=1) <= _OUTSIDE**2)


def ignorance(J: Array, span: Array, sizes: Array, lost: Mask) -> Array:
    """What values that were not estimated add to the covariance of all, shape (p, p), SI.

    J : ndarray, shape (N, p), independent rows of unit variance
    span : ndarray, shape (p, k), directions that are estimated
    sizes : ndarray, shape (p,), SI, plausible sizes; lost : ndarray of bool, shape (p,)

    A lost value stays at nominal and is off by its plausible size; least squares put as much of that
    into the others as moves the rows alike. So it adds nothing where it shows as it did in the rows,
    and its own size where it shows by itself. The sum with :func:`covariance` is that of the whole
    under a normal prior of those sizes on the lost values and none on the others; a prior on all could
    only lower it.
    """
    own = np.diag(sizes)[:, lost]
    J = condensed(J)
    back, scale = _inverse(J @ span)
    absorbed = back @ back.T @ ((J @ span / scale).T @ (J @ own))
    V = own - (span / scale) @ absorbed
    return np.asarray(V @ V.T)


def half(cov: Array) -> Array:
    """H (p, k) with ``H H^T`` the covariance (p, p), without directions in which there is nothing."""
    roots, axes = np.linalg.eigh((cov + cov.T) / 2.0)
    scale = np.sqrt(np.maximum(roots, 0.0))
    return np.asarray((axes * scale)[:, scale > 0.0])


def root(J: Array, span: Array) -> Array:
    """H (p, k) with ``H H^T`` the :func:`covariance`, ``span (span^T J^T J span)^-1 span^T``."""
    back, scale = _inverse((condensed(J) if len(span) <= _ALL * span.shape[1] else J) @ span)
    return np.asarray(span @ (back / scale[:, None]))


def _inverse(columns: Array) -> tuple[Array, Array]:
    """Inverse of the triangle of columns (N, k) made one long, (k, k), and their lengths (k,).

    What a search left undetermined after all has no inverse and stays as it is, at no deviation.
    """
    scale = np.linalg.norm(columns, axis=0)
    scale = np.asarray(np.where(scale > 0.0, scale, 1.0), dtype=float)
    return np.asarray(np.linalg.pinv(triangle(columns / scale), rcond=_NUMERICAL)), scale


def correlation(cov: Array) -> Array:
    """Correlation matrix, shape (p, p), of the covariance, shape (p, p).

    Rows of parameters that were not estimated are zero off the diagonal.
    """
    std = np.sqrt(np.diag(cov))
    out = cov / np.where(std == 0.0, 1.0, std)[:, None] / np.where(std == 0.0, 1.0, std)
    np.fill_diagonal(out, 1.0)
    return out


def working_points(model: Model) -> Model:
    """The model at the points where its accuracy counts.

    Those that are read, or the tip's origin where they are not part of the model.
    """
    known = not any(isinstance(e, Tool) for e in model.effects)
    return at_tip(model) if known else at_points_read(model)


def at_tip(model: Model) -> Model:
    """The model with the tip's origin in place of its markers, read by a tracker."""
    frames = read_frames(model)
    frame = frames if len(frames) == 1 else model.robot.on_tip(1)
    model = replace(model, marker_names=("tip",), markers=np.zeros((1, 3)), marker_frames=frame)
    return model if _plain(model) else replace(model, instruments=(_tracker(model, None),))


def read_frames(model: Model) -> IntArray:
    """Frames of the tips on which anything is read, ascending."""
    return np.unique(model.marker_frames[model.readout.channels.marker])


def at_one_tip(model: Model, frame: int) -> Model:
    """The model with a tracker on what is read of one tip; itself where nothing is read elsewhere."""
    if len(read_frames(model)) == 1:
        return model
    read = np.unique(model.readout.channels.marker)
    own = tuple(read[model.marker_frames[read] == frame].tolist())
    return replace(model, instruments=(_tracker(model, own),))


def at_points_read(model: Model) -> Model:
    """The model with a tracker on its markers, and on origins of frames; of a tracker itself.

    The ends of a frame's axes are not where anybody works.
    """
    if _plain(model):
        return model
    read = tuple(np.unique(model.readout.channels.marker).tolist())
    return replace(model, instruments=(_tracker(model, read),))


def _plain(model: Model) -> bool:
    """Whether one tracker reads every marker."""
    (first, *others) = model.instruments
    return not others and type(first) is Tracker and first.markers is None


def _tracker(model: Model, read: tuple[int, ...] | None) -> Tracker:
    """In the frame of the first that is one, or in base axes where there is none."""
    standing = (i.name for i in model.instruments if isinstance(i, Tracker) and i.seat is None)
    name = next(standing, "")
    return Tracker(name=name, markers=read)


def errors_at(model: Model, values: Array, cov: Array, targets: Poses) -> Array:
    """Expected position error at each target from the estimate's uncertainty, RMS, shape (m,), m.

    3-D per point, in the instrument's frame, at the points of :func:`working_points`.
    """
    model = working_points(model)
    _, J = model.jacobian_at_rest(values, targets)
    squared = np.einsum("mjip,pq,mjiq->m", J, cov, J, optimize=True) / J.shape[1]
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


def task_error(errors: Array, weights: Array) -> tuple[float, float]:
    """RMS and worst of the errors at targets, in their unit (``rho_0``, Wu et al. 2012).

    errors, weights : ndarray, shape (m,)
    """
    return (float(np.sqrt(weights @ errors**2 / weights.sum())), float(errors[weights > 0].max()))


def accuracy(
    model: Model, values: Array, cov: Array, targets: Poses, weights: Array
) -> tuple[float, float]:
    """Expected position error [m] at targets, RMS and worst: ``task_error`` of ``errors_at``."""
    return task_error(errors_at(model, values, cov, targets), weights)
