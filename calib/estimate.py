"""What a result knows of the robot: the model, its values, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.covariance import ignorance
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.screen import refuted
from calib.diagnosis.stage import Fit
from calib.identify.identification import Identification
from calib.model import Model
from calib.poses import Measurements
from calib.se3 import Array

Result: TypeAlias = Identification | Diagnosis
Mask: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True)
class Unexplained:
    """3-D RMS per point [m] of what the model leaves beside noise and its parameters' uncertainty.

    source : "held-out poses", every one of them, those that stand out too: nothing shows that targets
        are better; else "fitted poses", less the outliers
    """

    rms: float
    source: str


@dataclass(frozen=True, eq=False)
class Estimate:
    """An identified model in the form in which one result is handed on to the next command.

    model : Model; values : ndarray, shape (p,), SI
    covariance : ndarray, shape (p, p), SI; what the poses did not determine enters with a plausible
        size, less what the other parameters took up of it
    start : float, s, time of the session's first pose, from which drift counts
    unexplained : Unexplained
    undetermined : tuple of str, ids of the parameters that keep their nominal values
    notes : tuple of str, what a user of the values should know
    converged : bool
    """

    model: Model
    values: Array
    covariance: Array
    start: float
    unexplained: Unexplained
    undetermined: tuple[str, ...]
    notes: tuple[str, ...] = ()
    converged: bool = True


def estimate_of(result: Result) -> Estimate:
    """What an identification or a diagnosis knows."""
    return _identified(result) if isinstance(result, Identification) else _diagnosed(result)


def _identified(result: Identification) -> Estimate:
    model, values, cov = result.model, result.values, result.covariance
    fitted = result.fit.data.take(~result.fit.outlier)
    lost = np.diag(cov) <= 0.0
    noise = result.noise
    sigma = noise.sigma
    if noise.source == "residual":  # that is what is to be explained
        sigma = noise.believed * (noise.replicate_factor or 1.0)
    held = result.heldout
    if held is None or not held.data.seen.any():
        rest = _left_in_fit(model, values, cov, fitted, sigma, result.rank)
    else:
        rest = _left_held_out(model, values, cov, held.data, sigma)
    return Estimate(
        model,
        values,
        result.knowledge,
        fitted.poses.start,
        rest,
        _names(model, lost),
        converged=result.status != "not_converged",
    )


def _diagnosed(result: Diagnosis) -> Estimate:
    """The model with all causes that have a name; what is merely located stays unexplained."""
    fit, scale = result.after, result.scale
    unnamed = [e.candidate for e in result.outcome.entries if not e.candidate.named]
    if unnamed:
        fit = result.stage.fit([cause.named.candidate.effect for cause in result.causes])
        scale = _scale(fit)
    model, values, cov = fit.model, fit.values, fit.covariance * scale**2
    fitted = result.data.take(~result.stage.dropped)
    lost = np.diag(cov) <= 0.0
    sigma = result.noise.sigma / result.scale
    if result.heldout is None or not result.heldout.seen.any():
        rest = _left_in_fit(model, values, cov, fitted, sigma, fit.span.shape[1])
    else:
        rest = _left_held_out(model, values, cov, result.heldout, sigma)
    return Estimate(
        model,
        values,
        cov + ignorance(fit.equations[1], fit.span, model.sizes, lost),
        result.data.poses.start,
        rest,
        _names(model, lost),
        _doubts(result),
        fit.converged,
    )


def _doubts(result: Diagnosis) -> tuple[str, ...]:
    notes = []
    for cause in result.causes:
        first, *others = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members]
        if others:
            notes.append(
                f"{first} stands for {' or '.join(others)} too, which the data cannot tell from it"
            )
    for entry in result.outcome.entries:
        if not entry.candidate.named:
            place = f"{entry.candidate.where} by {entry.candidate.depends_on}"
            notes.append(f"not corrected: the gap located at {place}, which has no named cause")
    return tuple(notes)


def _scale(fit: Fit) -> float:
    """Actual over stated standard deviation, from the residual where that refutes the stated one."""
    cost = float((fit.r**2).sum())
    dof = int(np.count_nonzero(np.abs(fit.J).sum(axis=-1))) - fit.span.shape[1]
    return float(np.sqrt(cost / dof)) if refuted(cost, dof) else 1.0


def _names(model: Model, chosen: Mask) -> tuple[str, ...]:
    return tuple(p.id for p, own in zip(model.parameters, chosen, strict=True) if own)


def _shares(model: Model, values: Array, cov: Array, data: Measurements) -> tuple[Array, Array]:
    """Squared error of every visible point, and what the parameters' uncertainty adds to it, m^2."""
    points, J = model.jacobian(values, data.poses)
    error = ((data.points - points) ** 2).sum(axis=-1)
    share = np.einsum("mjip,pq,mjiq->mj", J, cov, J, optimize=True)
    return error[data.seen], share[data.seen]


def _left_in_fit(
    model: Model, values: Array, cov: Array, data: Measurements, sigma: float, rank: int
) -> Unexplained:
    """``u^2 = rms^2 + s^2 - 3 sigma^2``: the fit hides the parameters' share s^2 of its own errors."""
    error, share = _shares(model, values, cov, data)
    excess = float(error.mean() + share.mean()) - 3.0 * sigma**2
    surely = excess > 0.0 and refuted(float(error.sum()) / sigma**2, 3 * len(error) - rank)
    return Unexplained(float(np.sqrt(excess)) if surely else 0.0, "fitted poses")


def _left_held_out(
    model: Model, values: Array, cov: Array, data: Measurements, sigma: float
) -> Unexplained:
    """``u^2 = rms^2 - s^2 - 3 sigma^2`` at poses that the parameters never saw."""
    error, share = _shares(model, values, cov, data)
    expected = 3.0 * sigma**2 + share
    excess = float(error.mean() - expected.mean())
    surely = excess > 0.0 and refuted(3.0 * float((error / expected).sum()), 3 * len(error))
    return Unexplained(float(np.sqrt(excess)) if surely else 0.0, "held-out poses")
