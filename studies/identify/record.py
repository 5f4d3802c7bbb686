"""What ``posecal identify`` finds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self, TypedDict

import numpy as np
from pydantic import Field, model_validator

from studies.estimate import Estimated, estimated
from studies.identify.acceptance import AcceptanceEntry, acceptance_entry
from studies.identify.budget import BudgetEntry, budget_entry
from studies.identify.drift import Drift, drift_entry
from studies.identify.errors import (
    Distances,
    Model,
    OfInstrument,
    Pairs,
    Residual,
    distances_entry,
    instrument_entries,
    pair_entries,
    residual_entries,
    rms_of,
)
from studies.identify.of_type import OfType, of_type_entry
from studies.identify.outliers import Outlier, Share, outlier_entries, share_entry
from studies.identify.parameters import (
    Absorbed,
    Parameter,
    Unidentifiable,
    absorbed_entries,
    parameter_entries,
    unidentifiable_entries,
)
from studies.identify.placement import Base, Placement, base_entry, body_entries, marker_entries
from studies.identify.sizes import Sizes, sizes_entry
from studies.noise import Noise, by_level
from studies.record import Count, Envelope, Maybe, NotNegative, Number, Record, Three
from studies.targets import AtTarget, at_targets

if TYPE_CHECKING:
    from calib import Identification
    from calib.compensation.estimate import Estimate
    from calib.drift import Drift as Moved
    from calib.uncertainty.acceptance import Judged
    from calib.uncertainty.budget import Budget

_MM = 1e3
_MOST = 3_000_000  # points; a damaged file may name poses and markers that fill any memory


class IdentifyNoise(Noise):
    """The noise that the standard deviations rest on, and what speaks for it."""

    replicate_sigma_mm: NotNegative | None
    lack_of_fit_p: Number
    degrees_of_freedom: Maybe = None


class Asked(TypedDict):
    """What the caller chose, beside approach and method."""

    weighting: Literal["full", "normalised", "plain"] | None
    length_mm: float | None
    differences: bool
    holdout: str | None


class IdentifyRecord(Record):
    """The identified parameters, how sure they are, and what they leave."""

    command: Literal["identify"] = "identify"
    weighting: Literal["full", "normalised", "plain"] | None
    length_mm: Maybe
    differences: bool
    holdout: str | None
    status: Literal["converged", "not_converged", "rank_deficient"]
    advice: str
    approach: Literal["points", "pose"]
    method: Literal["joint", "two-step"]
    noise: IdentifyNoise
    poses: Count
    points: Count
    rank: Count
    degrees_of_freedom: Count
    iterations: Count
    parameters: tuple[Parameter, ...] = Field(min_length=1)
    weak: tuple[str, ...]
    unused_poses: tuple[str, ...]
    before_the_first_move: tuple[str, ...] = ()
    unidentifiable: tuple[Unidentifiable, ...]
    absorbed: tuple[Absorbed, ...]
    outliers: tuple[Outlier, ...]
    outliers_share: Share | None = None
    heldout_outliers: tuple[Outlier, ...]
    rms_mm: Distances
    max_mm: Distances
    p95_mm: Distances
    instruments: tuple[OfInstrument, ...] = ()
    pair_distances_mm: dict[Model, Pairs]
    rms_of_residuals_mm: NotNegative | None
    base: Base
    markers_mm: dict[str, Three]
    bodies: dict[str, Placement] = Field(default_factory=dict)
    correlation: tuple[tuple[Maybe, ...], ...]
    residuals: tuple[Residual, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    targets: str
    at_targets: tuple[AtTarget, ...] = Field(min_length=1)
    budget: BudgetEntry | None = None
    acceptance: AcceptanceEntry | None = None
    drift: Drift | None = None
    of_type: OfType | None = None
    sizes: Sizes | None = None
    estimate: Estimated

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        size = len(self.parameters)
        if any(len(rows) != size for rows in (self.correlation, *self.correlation)):
            raise ValueError("correlation has not a row and a column for each parameter")
        poses = {(row.pose, row.heldout) for row in self.residuals}
        if len(poses) * len({row.marker for row in self.residuals}) > _MOST:
            raise ValueError("residuals have too many poses and markers")
        metric = any(row.metric for row in self.residuals)
        if metric == (None in (self.rms_mm.nominal, self.rms_mm.fitted_all)):
            raise ValueError("rms_mm has figures where no residual is a length, or lacks them")
        named = {own.instrument for own in self.instruments}
        if not metric and not named >= {row.instrument for row in self.residuals}:
            raise ValueError("instruments lacks one that residuals name")
        told = [self.rms_mm.heldout, *(own.heldout for own in self.instruments)]
        held = any(figure is not None for figure in told)
        if {row.heldout for row in self.residuals} != {False, held}:
            raise ValueError("residuals and rms_mm are not of the same poses")
        return self

    @property
    def held_out(self) -> bool:
        """Whether there were poses that took no part."""
        return any(row.heldout for row in self.residuals)

    @property
    def nominal_at_heldout_mm(self) -> float | None:
        """RMS of the nominal model at the points held out."""
        own = (row for row in self.residuals if row.heldout and row.metric)
        held = [float(np.linalg.norm(row.before)) for row in own]
        return float(np.sqrt(np.mean(np.square(held)))) if held else None


def identify_record(
    found: Identification,
    accuracy: Budget,
    drift: Moved | None,
    estimate: Estimate,
    asked: Asked,
    made_from: Envelope,
    warnings: tuple[str, ...] = (),
    judged: Judged | None = None,
) -> IdentifyRecord:
    """The record of an identification.

    accuracy : to expect at the targets; drift : what readings that were repeated say
    warnings : of the tables, beside those of the identification
    judged : the held-out points against the cell's tolerance
    """
    from calib.identification import ADVICE

    fit, held = found.fit, found.heldout
    return IdentifyRecord(
        **made_from,
        **asked,
        warnings=(*warnings, *found.warnings),
        status=found.status,
        advice=ADVICE[found.status],
        approach=found.approach,
        method=found.method,
        noise=_noise(found),
        poses=len(fit.data),
        points=int(fit.data.seen.sum()),
        rank=found.rank,
        degrees_of_freedom=found.dof,
        iterations=found.iterations,
        parameters=tuple(parameter_entries(found)),
        weak=found.weak,
        unused_poses=(*found.unused, *found.waiting),
        before_the_first_move=found.waiting,
        unidentifiable=unidentifiable_entries(found),
        absorbed=absorbed_entries(found),
        outliers=tuple(outlier_entries(fit, found.footprint)),
        outliers_share=share_entry(found.shared),
        heldout_outliers=() if held is None else tuple(outlier_entries(held, found.footprint)),
        rms_mm=distances_entry(found, rms_of),
        max_mm=distances_entry(found, lambda d: float(d.max())),
        p95_mm=distances_entry(found, lambda d: float(np.quantile(d, 0.95))),
        instruments=instrument_entries(found),
        pair_distances_mm=dict(pair_entries(found)),
        rms_of_residuals_mm=rms_of(fit.lengths()) * _MM if fit.channels.metric else None,
        base=base_entry(found),
        markers_mm=marker_entries(found),
        bodies=body_entries(found),
        correlation=tuple(map(tuple, np.round(found.correlation, 4).tolist())),
        residuals=(
            *residual_entries(found, fit),
            *(() if held is None else residual_entries(found, held)),
        ),
        task_rms_mm=accuracy.rms(accuracy.expected.errors) * _MM,
        task_worst_mm=accuracy.worst(accuracy.expected.errors) * _MM,
        targets=accuracy.source,
        at_targets=at_targets(
            found.model.robot,
            accuracy.targets,
            accuracy.expected.errors,
            accuracy.expected.expanded,
        ),
        budget=budget_entry(accuracy),
        acceptance=acceptance_entry(judged),
        drift=None if drift is None else drift_entry(drift),
        of_type=None if found.of_type is None else of_type_entry(found),
        sizes=None if found.sizes is None else sizes_entry(found.sizes),
        estimate=estimated(estimate),
    )


def _noise(found: Identification) -> IdentifyNoise:
    noise, mm = found.noise, found.footprint * _MM
    again = noise.replicate_factor
    return IdentifyNoise(
        sigma_mm=noise.sigma * mm,
        believed_sigma_mm=noise.believed * mm,
        source=noise.source,
        replicate_sigma_mm=None if again is None else again * noise.believed * mm,
        lack_of_fit_p=noise.lack_of_fit_p,
        degrees_of_freedom=float(noise.dof),
        **by_level(found.levels, found.scatter, found.model.robot.reach),
    )
