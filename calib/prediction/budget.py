"""The uncertainty budget: what each source does to a point at the targets, and what covers them all.

An error at a target has three coordinates at each of the M points of a target; its length counts as RMS
over them. A source moves them by ``spread @ z`` with independent z of unit variance, so variances add.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.identification import Identification
from calib.inference.coverage import coverage_factor, directions, effective_freedom, freedom
from calib.model.covariance import half, working_points
from calib.poses import Poses
from calib.prediction.estimate import Estimate, ExpectedError

_NOISE = "noise"

Evaluation = Literal["A", "B"]
"""By statistics of the readings in hand, or by what is known otherwise (JCGM 100, 4.2 and 4.3)."""


@dataclass(frozen=True, eq=False)
class UncertaintySource:
    """One source.

    spread : ndarray, shape (m, 3 M, k), m, of the error at each target
    freedom : degrees of freedom of its variance
    basis : str, the estimate that its variance rests on: parts of one count their freedom once
    of : whether the calibration brings it, the arm itself, or what the model lacks
    """

    source: str
    evaluation: Evaluation
    spread: Array
    freedom: float
    basis: str = ""
    of: Literal["calibration", "arm", "model"] = "calibration"

    @property
    def errors(self) -> Array:
        """Standard uncertainty at each target, shape (m,), m."""
        return np.asarray(np.linalg.norm(self.spread, axis=(-1, -2)))


class CombinedUncertainty(NamedTuple):
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

    weights : ndarray, shape (m,)
    """

    weights: Array
    parts: tuple[UncertaintySource, ...]

    @property
    def calibration(self) -> tuple[UncertaintySource, ...]:
        """What the parameters bring."""
        return tuple(part for part in self.parts if part.of == "calibration")

    @property
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
    """The budget of an identification at the cell's targets."""
    return budget_of(found, estimate, *targets_of(cell))


def budget_of(
    found: Identification, estimate: Estimate | None, targets: Poses, weights: Array
) -> Budget:
    """The budget of an identification at targets; weights : ndarray, shape (m,).

    estimate : of the same, for what arm and model add beside the parameters; None leaves them out
    """
    model, values = working_points(found.model), found.values
    _, J = model.jacobian_at_rest(values, targets)
    m, M = J.shape[:2]

    def spread(square: Array) -> Array:
        """Of errors (m, 3 M, k) by a mean square (p, p) of what the values are off by."""
        return np.asarray((J @ half(square)).reshape(m, 3 * M, -1) / np.sqrt(M))

    parts = list(_of_calibration(found, spread(found.covariance), spread(found.ignorance)))
    if estimate is not None:
        trend = None if estimate.trend is None else spread(estimate.trend)
        parts += _beside(found, estimate, targets, M, trend)
    return Budget(weights, tuple(parts))


def _of_calibration(
    found: Identification, by_noise: Array, by_ignorance: Array
) -> Iterator[UncertaintySource]:
    """What the uncertainty of the parameters does at the targets, source by source."""
    kind: Evaluation = "B" if found.noise.source == "cell" and found.freedom == np.inf else "A"
    name = "noise of the readings"
    yield UncertaintySource(name, kind, by_noise, found.freedom, basis=_NOISE)
    if found.ignorance.any():
        name = "parameters that are not identifiable"
        yield UncertaintySource(name, "B", by_ignorance, np.inf)


def _beside(
    found: Identification, estimate: Estimate, targets: Poses, points: int, trend: Array | None
) -> Iterator[UncertaintySource]:
    """The arm's scatter and the model discrepancy, which move the points of a target as one.

    trend : ndarray, shape (m, 3 M, k), m, spread of what the trend of the day adds, None without one
    """
    error, rest = ExpectedError(estimate, targets), estimate.discrepancy
    as_one = np.tile(np.eye(3), (points, 1)) / np.sqrt(3.0 * points)
    if error.arm.any():
        shown = found.levels is not None and found.levels.estimated
        both = estimate.configuration_of == "undecided"
        yield UncertaintySource(
            "arm or model, from pose to pose" if both else "repeatability of the arm",
            "A" if shown else "B", error.arm[:, None, None] * as_one, found.freedom, basis=_NOISE,
            of="arm",
        )  # fmt: skip
    lacks = f"what the model lacks, from {rest.source if rest.rms else 'the fitted poses'}"
    if error.discrepancy.any():
        spread = error.discrepancy[:, None, None] * as_one
        yield UncertaintySource(lacks, "A", spread, _poses_behind(found), of="model")
    if trend is not None:
        name = "trend of the day, carried on to the targets' time"
        yield UncertaintySource(name, "A", trend, _poses_behind(found), of="model")
    for one, spread in error.by_effect:
        if spread.any():
            name = f"{one.kind}, never measured"
            yield UncertaintySource(name, "B", spread, one.freedom, of="model")


def _poses_behind(found: Identification) -> float:
    """Degrees of freedom of a discrepancy: a configuration counts as one, whatever its points."""
    held = found.heldout
    if held is not None and held.data.seen.any():
        return float(len(np.unique(held.data.poses.configuration)))
    fitted = len(np.unique(found.fit.data.poses.configuration[~found.fit.outlier]))
    return freedom(np.inf, fitted, found.rank, as_a_whole=True)


def combined(parts: Sequence[UncertaintySource], weights: Array) -> CombinedUncertainty:
    """Combine sources into the uncertainty at each target."""
    bases: dict[str, list[UncertaintySource]] = {}
    for k, part in enumerate(parts):
        bases.setdefault(part.basis or str(k), []).append(part)
    variances = [np.sum([p.errors**2 for p in group], axis=0) for group in bases.values()]
    freedoms = [group[0].freedom for group in bases.values()]
    nu = effective_freedom(zip(variances, freedoms, strict=True))
    n = directions(np.concatenate([part.spread for part in parts], axis=-1))
    mean = [float(weights @ variance / weights.sum()) for variance in variances]
    errors = np.sqrt(np.sum(variances, axis=0))
    return CombinedUncertainty(
        errors,
        coverage_factor(nu, n) * errors,
        float(effective_freedom(zip(mean, freedoms, strict=True))),
    )
