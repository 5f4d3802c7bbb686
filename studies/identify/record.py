"""What ``posecal identify`` finds: how far the robot was off, and each parameter."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from studies.fitted import Estimated
from studies.identify.budget import AcceptanceEntry, BudgetEntry
from studies.identify.errors import (
    ErrorFigures,
    IdentifyResidual,
    Model,
    OfInstrument,
    PairErrors,
)
from studies.identify.parameters import (
    IdentifiedParameter,
    LensValue,
    RedundantParameter,
    SizePrior,
)
from studies.noise import NoiseEntry
from studies.record import (
    BeforeAfter,
    Count,
    Entry,
    From,
    Maybe,
    NotNegative,
    Number,
    Outlier,
    Record,
    Three,
    UnidentifiableEntry,
)


class IdentifyNoise(NoiseEntry):
    """The noise that the standard deviations rest on, and what speaks for it."""

    replicate_sigma_mm: NotNegative | None
    lack_of_fit_p: Number
    degrees_of_freedom: Annotated[Maybe, From("dof")]


class Placement(Entry):
    """The base in the frame of the readings."""

    rotation_vector_rad: Three
    translation_mm: Three


class Placements(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement]


class IdentifyRecord(Record):
    """The identified parameters, how sure they are, and what they leave."""

    command: Literal["identify"] = "identify"
    weighting: Literal["full", "normalised", "plain"] | None
    length_mm: Maybe
    holdout: str | None
    status: Literal["converged", "not_converged", "rank_deficient"]
    advice: str
    approach: Literal["points", "pose"]
    method: Literal["joint", "two-step"]
    noise: IdentifyNoise
    poses: Annotated[Count, From("fit.data")]
    points: Count
    rank: Count
    degrees_of_freedom: Annotated[Count, From("dof")]
    iterations: Count
    parameters: tuple[IdentifiedParameter, ...] = Field(min_length=1)
    weak: tuple[str, ...]
    unused_poses: tuple[str, ...]
    before_the_first_move: Annotated[tuple[str, ...], From("waiting")]
    unidentifiable: tuple[UnidentifiableEntry, ...]
    absorbed: tuple[RedundantParameter, ...]
    outliers: tuple[Outlier, ...]
    heldout_outliers: tuple[Outlier, ...]
    rms_mm: ErrorFigures
    max_mm: ErrorFigures
    p95_mm: ErrorFigures
    instruments: tuple[OfInstrument, ...]
    pair_distances_mm: dict[Model, PairErrors]
    rms_of_residuals_mm: NotNegative | None
    base: Placements
    markers_mm: dict[str, Three]
    bodies: dict[str, Placement]
    correlation: tuple[tuple[Maybe, ...], ...]
    residuals: tuple[IdentifyResidual, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    targets: str
    budget: BudgetEntry
    acceptance: AcceptanceEntry | None
    drift_p: Maybe
    sizes: SizePrior | None
    lenses: tuple[LensValue, ...]
    estimate: Estimated

    @property
    def held_out(self) -> bool:
        """Whether there were poses that took no part."""
        return any(row.heldout for row in self.residuals)

    @cached_property
    def error(self) -> BeforeAfter:
        """RMS by the nominal and by the identified model, held out where anything was."""
        return self.error_at(heldout=self.held_out)

    def error_at(self, *, heldout: bool) -> BeforeAfter:
        """In space; where no reading is a length, of the instrument that is predicted worst."""
        rows, unit = [row for row in self.residuals if row.heldout == heldout], "mm"
        if any(row.metric for row in rows):
            rows = [row for row in rows if row.metric]
        else:
            worst = max(self.instruments, key=lambda own: own.heldout or own.fitted_all or 0.0)
            rows, unit = [row for row in rows if row.instrument == worst.instrument], worst.unit
        before, after = (
            float(np.sqrt(np.mean([np.square(vector).sum() for vector in vectors])))
            for vectors in ([row.before for row in rows], [row.vector for row in rows])
        )
        judged = None if self.acceptance is None else self.acceptance.judgement
        return BeforeAfter(before, after, "RMS error at {where}", unit, heldout, judged=judged)
