"""Regression of what is left on all that is known of a pose; it names nothing.

After the cell's model is identified, the residuals of all points of a pose, in base axes, follow a
Gaussian process over joint values, wrench, time, temperature and approach, with one length a variable
(Rasmussen and Williams 2006, section 5.1), by scikit-learn. There is a gap where the process predicts
configurations that it has not seen better than no correction does.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import calib
from calib import Cell, Identification, Measurements
from calib.arrays import Array
from calib.identification.residuals import Residuals
from calib.poses import Poses
from studies.research.rivals.answer import answer

_FOLDS = 5
_LEVEL = 0.05  # of the test; configurations left out are predicted from four fifths of the data
_ITERATIONS = 40  # of the search for lengths; more gain nothing on held-out poses


def black_box(cell: Cell, data: Measurements, heldout: Measurements) -> dict[str, Any]:
    """Answer in the form of ``diagnose --json``: no gap, or unknown with the error that remains.

    Raises CalibError where the model cannot be identified.
    """
    fit = calib.identify(cell, data, heldout=heldout)
    assert fit.heldout is not None  # noqa: S101
    kept = ~fit.fit.outlier
    Y = in_base(fit, fit.fit)[kept]
    X, X_held = scaled(inputs(data.poses)[kept], inputs(heldout.poses))
    if not improves(X, Y, data.poses.configuration[kept]):
        return answer("no_gap", fit, fit.rms("heldout"))
    rest = in_base(fit, fit.heldout) - learned(X, Y).predict(X_held)
    squared = (rest.reshape(fit.heldout.vectors.shape) ** 2).sum(axis=-1)
    return answer("unknown", fit, float(np.sqrt(squared[fit.heldout.data.seen].mean())))


def in_base(fit: Identification, residuals: Residuals) -> Array:
    """Residuals of each pose in base axes, shape (m, 3 M), m; hidden points err as those seen do."""
    R, _ = fit.model.placement(fit.values, residuals.data.poses)
    vectors, seen = residuals.vectors @ R, residuals.data.seen[..., None]
    mean = vectors.sum(axis=1, keepdims=True) / np.maximum(seen.sum(axis=1, keepdims=True), 1)
    whole: Array = np.where(seen, vectors, mean).reshape(len(vectors), -1)
    return whole


def inputs(poses: Poses) -> Array:
    """All that the table says of each pose, shape (m, d)."""
    given = [poses.q, poses.wrench, poses.time, poses.temperature, poses.approach]
    return np.column_stack([column for column in given if column is not None])


def scaled(X: Array, other: Array) -> tuple[Array, Array]:
    """Both in standard deviations of the first about its mean, without what never changes."""
    mean, spread = X.mean(axis=0), X.std(axis=0)
    changes = spread > 1e-9 * np.maximum(np.abs(X).max(axis=0), 1e-9)
    return tuple(((A - mean) / np.where(changes, spread, 1.0))[:, changes] for A in (X, other))


def learned(X: Array, Y: Array) -> Any:
    """Gaussian process through (m, d) -> (m, 3 M); lengths and noise by maximum likelihood."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    lengths = RBF(np.full(X.shape[1], 4.0), (0.3, 1e3))
    kernel = ConstantKernel(0.3, (1e-3, 1e2)) * lengths + WhiteKernel(0.7, (1e-3, 2.0))
    process = GaussianProcessRegressor(kernel, optimizer=_search, normalize_y=True)
    with warnings.catch_warnings():
        # A length at its bound is a variable that does not matter.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(X, Y)


def improves(X: Array, Y: Array, configuration: NDArray[np.int_]) -> bool:
    """Whether configurations left out, whole, are predicted better than by nothing: a paired t test."""
    from scipy.stats import ttest_1samp
    from sklearn.model_selection import GroupKFold

    gain = np.empty(len(Y))
    for fitted, left in GroupKFold(_FOLDS).split(X, Y, configuration):
        rest = Y[left] - learned(X[fitted], Y[fitted]).predict(X[left])
        gain[left] = (Y[left] ** 2).sum(axis=1) - (rest**2).sum(axis=1)
    mean = [gain[configuration == c].mean() for c in np.unique(configuration)]
    return bool(ttest_1samp(mean, 0.0, alternative="greater").pvalue < _LEVEL)


def _search(
    objective: Callable[[Array], tuple[float, Array]], start: Array, bounds: Array
) -> tuple[Array, float]:
    found = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _ITERATIONS},
    )
    return found.x, float(found.fun)
