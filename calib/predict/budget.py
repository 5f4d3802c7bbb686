"""The uncertainty budget: what each source does to a point at the targets, and what covers them all.

An error at a target has three coordinates at each of the M points of a target; its length counts as RMS
over them. A source moves them by ``spread @ z`` with independent z of unit variance, so variances add.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calib.arm.se3 import skew
from calib.arrays import Array, stacked
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.identification import Identification
from calib.inference.coverage import coverage_factor, directions, effective_freedom, freedom
from calib.model.covariance import half, working_points
from calib.poses import Poses
from calib.predict.discrepancy import scatter_at
from calib.predict.estimate import Estimate

_NOISE = "noise"

Evaluation = Literal["A", "B"]
"""By statistics of the readings in hand, or by what is known otherwise (JCGM 100, 4.2 and 4.3)."""


@dataclass(frozen=True, eq=False)
class UncertaintySource:
    """One source.

    spread : ndarray, shape (m, 3 M, k), m, of the error at each target
    placed : the same with the base placed anew at the targets, where all that moves them as one is gone
    freedom : degrees of freedom of its variance
    stated : float or None, SI, as the cell gives it; divisor : that makes it one standard uncertainty
    unit, scale : of that, and SI per unit
    at_reading : float or None, m, RMS by which it moves one reading
    instrument : str, whose common error it is; empty where it is none
    basis : str, the estimate that its variance rests on: parts of one count their freedom once
    of : whether the calibration brings it, the arm itself, or what the model lacks
    """

    source: str
    evaluation: Evaluation
    spread: Array
    placed: Array
    freedom: float
    stated: float | None = None
    divisor: float = 1.0
    unit: str = "mm"
    scale: float = 1e-3
    distribution: str = "normal"
    at_reading: float | None = None
    instrument: str = ""
    basis: str = ""
    of: Literal["calibration", "arm", "model"] = "calibration"

    @property
    def errors(self) -> Array:
        """Standard uncertainty at each target, shape (m,), m."""
        return np.asarray(np.linalg.norm(self.spread, axis=(-1, -2)))

    @property
    def errors_placed(self) -> Array:
        """Standard uncertainty at each target with the base placed anew, shape (m,), m."""
        return np.asarray(np.linalg.norm(self.placed, axis=(-1, -2)))

    @property
    def std(self) -> float | None:
        """One standard uncertainty of the source itself, SI."""
        return None if self.stated is None else self.stated / self.divisor


@dataclass(frozen=True, eq=False)
class CombinedUncertainty:
    """Combined and expanded uncertainty of several sources at m targets.

    errors, expanded : ndarray, shape (m,), m, RMS length of the error, and the length within which 95 %
        of errors stay
    freedom : effective degrees of freedom of the mean square over the targets
    """

    errors: Array
    expanded: Array
    freedom: float


@dataclass(frozen=True, eq=False)
class Budget:
    """Sources of error at m targets.

    calibration, beside : parts that the parameters bring to each target, and all others
    weights : ndarray, shape (m,), of the targets; source : str, what the targets are
    """

    targets: Poses
    weights: Array
    calibration: tuple[UncertaintySource, ...]
    beside: tuple[UncertaintySource, ...] = ()
    source: str = ""

    @property
    def parts(self) -> tuple[UncertaintySource, ...]:
        """All of them."""
        return self.calibration + self.beside

    @cached_property
    def expected(self) -> CombinedUncertainty:
        """Uncertainty at the targets from the parameters alone."""
        return combined(self.calibration, self.weights)

    def rms(self, lengths: Array) -> float:
        """Over the targets by their weights, of lengths (m,)."""
        return float(np.sqrt(self.weights @ lengths**2 / self.weights.sum()))

    def worst(self, lengths: Array) -> float:
        """The largest of lengths (m,) among targets that have a weight."""
        return float(lengths[self.weights > 0.0].max())


def accuracy_at_targets(
    cell: Cell, found: Identification, estimate: Estimate | None = None
) -> Budget:
    """What the uncertainty of identified parameters leaves at the cell's targets.

    estimate : of the same identification, for what the arm and the model's lacks add beside it
    """
    targets, weights = targets_of(cell)
    budget = budget_of(found, estimate, targets, weights)
    return replace(budget, source=cell.targets_in_words)


def budget_of(
    found: Identification,
    estimate: Estimate | None,
    targets: Poses,
    weights: Array,
) -> Budget:
    """The budget of an identification at targets; weights : ndarray, shape (m,).

    estimate : of the same, for what the arm and the model's lacks add; without it that is left out
    """
    calibration = tuple(of_calibration(found, targets, weights))
    if estimate is None:
        return Budget(targets, weights, calibration)
    beside = (*_of_arm(found, estimate, targets), *_of_model(found, estimate, targets))
    return Budget(targets, weights, calibration, beside)


def combined(parts: Sequence[UncertaintySource], weights: Array) -> CombinedUncertainty:
    """Combine sources into the uncertainty at each target."""
    bases: dict[str, list[UncertaintySource]] = {}
    for k, part in enumerate(parts):
        bases.setdefault(part.basis or str(k), []).append(part)
    variances = [np.sum([part.errors**2 for part in own], axis=0) for own in bases.values()]
    freedoms = [own[0].freedom for own in bases.values()]
    total = np.sum(variances, axis=0)
    nu = effective_freedom(zip(variances, freedoms, strict=True))
    n = directions(np.concatenate([part.spread for part in parts], axis=-1))
    mean = [float(weights @ own / weights.sum()) for own in variances]
    errors = np.sqrt(total)
    return CombinedUncertainty(
        errors,
        coverage_factor(nu, n) * errors,
        float(effective_freedom(zip(mean, freedoms, strict=True))),
    )


def of_calibration(
    found: Identification, targets: Poses, weights: Array
) -> Iterator[UncertaintySource]:
    """What the uncertainty of the parameters does at the targets, source by source."""
    model, values = working_points(found.model), found.values
    points, J = model.jacobian_at_rest(values, targets)
    anew = _Anew.at(points, weights)
    noise = found.noise
    sigma = noise.sigma * found.footprint
    told = noise.source == "cell" and found.freedom == np.inf
    spread = _spread(J @ half(found.covariance))
    yield UncertaintySource(
        "noise of the readings", "B" if told else "A", spread, anew(spread), found.freedom,
        stated=sigma, at_reading=sigma * _numbers(found), basis=_NOISE,
    )  # fmt: skip
    if found.ignorance.any():
        spread = _spread(J @ half(found.ignorance))
        yield UncertaintySource(
            "parameters that are not identifiable", "B", spread, anew(spread), np.inf
        )
    for one in found.common:
        error, spread = one.error, _spread(one.at(model, values, J, targets))
        yield UncertaintySource(
            error.kind.source, "B", spread, anew(spread), error.freedom, error.stated,
            error.divisor, error.kind.unit, error.kind.scale, error.distribution, one.at_reading,
            one.instrument,
        )  # fmt: skip


def _of_arm(
    found: Identification, estimate: Estimate, targets: Poses
) -> Iterator[UncertaintySource]:
    """How the arm scatters; with what these data do not tell from the model's lacks."""
    variances = scatter_at(estimate.model, estimate.values, targets, estimate.arm)
    if variances.any():
        spread = _alike(variances.mean(axis=-1), variances.shape[1])
        shown = found.levels is not None and len(found.levels.free) > 0
        both = estimate.rest_of == "undecided"
        yield UncertaintySource(
            "arm or model, from pose to pose" if both else "repeatability of the arm",
            "A" if shown else "B", spread, spread, found.freedom, basis=_NOISE, of="arm",
        )  # fmt: skip


def _of_model(
    found: Identification, estimate: Estimate, targets: Poses
) -> Iterator[UncertaintySource]:
    """What the model lacks: from pose to pose, and at poses that the fit was without."""
    unfollowed = scatter_at(estimate.model, estimate.values, targets, estimate.unfollowed)
    rest, M = estimate.unexplained, unfollowed.shape[1]
    variances = unfollowed.mean(axis=-1) + rest.rms**2
    if variances.any():
        by = rest.source if rest.rms else "the fitted poses"
        spread = _alike(variances, M)
        name = f"what the model lacks, from {by}"
        yield UncertaintySource(name, "A", spread, spread, _behind(found), of="model")


def _behind(found: Identification) -> float:
    """Degrees of freedom of what is unexplained: a configuration counts as one, whatever its points."""
    held = found.heldout
    if held is not None and held.data.seen.any():
        return float(len(np.unique(held.data.poses.configuration)))
    fitted = len(np.unique(found.fit.data.poses.configuration[~found.fit.outlier]))
    return freedom(np.inf, fitted, found.rank, as_a_whole=True)


def _spread(moved: Array) -> Array:
    """RMS over the points of a target, shape (m, 3 M, k), of displacements (m, M, 3, k)."""
    m, M = moved.shape[:2]
    return np.asarray(moved.reshape(m, 3 * M, moved.shape[-1]) / np.sqrt(M))


def _alike(variances: Array, M: int) -> Array:
    """Errors (m,), m^2, that move the M points of a target as one, alike in all directions."""
    return np.asarray(
        np.sqrt(variances / 3.0)[:, None, None] * np.tile(np.eye(3), (M, 1)) / np.sqrt(M)
    )


def _numbers(found: Identification) -> float:
    """Root of how many numbers a reading has whose noise is one of its coordinates."""
    channels = found.model.readout.channels
    lengths = channels.lengths if channels.metric else np.ones_like(channels.lengths)
    return float(
        np.sqrt((found.fit.data.seen * lengths.sum(axis=-1)).sum() / found.fit.data.seen.sum())
    )


@dataclass(frozen=True, eq=False)
class _Anew:
    """Takes off what moves all targets as one rigid body; basis : ndarray, shape (m 3 M, 6)."""

    basis: Array
    root: Array

    @classmethod
    def at(cls, points: Array, weights: Array) -> _Anew:
        """points : ndarray, shape (m, M, 3), m; weights : ndarray, shape (m,)."""
        away = points - points.mean(axis=(0, 1))
        eye = np.broadcast_to(np.eye(3), (*points.shape, 3))
        size = float(np.abs(away).max()) or 1.0
        motions = np.concatenate([eye, skew(away) / size], axis=-1)
        root = np.sqrt(weights).repeat(3 * points.shape[1])
        U, s, _ = np.linalg.svd(root[:, None] * motions.reshape(-1, 6), full_matrices=False)
        return cls(U[:, s > 1e-9 * s[0]], root)

    def __call__(self, spread: Array) -> Array:
        flat = self.root[:, None] * stacked(spread)
        rest = flat - self.basis @ (self.basis.T @ flat)
        safe = np.where(self.root > 0.0, self.root, 1.0)
        return np.asarray((rest / safe[:, None]).reshape(spread.shape))
