"""What ``posecal identify`` finds, and what it says: how far the robot was off, and each parameter."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies.document import MRAD, Document, Figure, Section, Sentence, mm
from studies.entries import TargetAccuracy, over_the_workspace
from studies.fitted import Estimated
from studies.identify.budget import AcceptanceEntry, BudgetEntry, accepted, budget_section
from studies.identify.drift import DriftEntry, drift_section
from studies.identify.errors import (
    ErrorFigures,
    IdentifyResidual,
    Model,
    OfInstrument,
    Pairs,
    told_errors,
)
from studies.identify.lenses import LensValue, UnfitLensEntry, told_lenses
from studies.identify.of_type import OfType, told_of_type
from studies.identify.outliers import OutliersTogether
from studies.identify.parameters import Absorbed, IdentifiedParameter, SizesEntry, told_parameters
from studies.noise import NoiseEntry, lacks, unusual
from studies.record import (
    BeforeAfter,
    Count,
    Entry,
    Maybe,
    NotNegative,
    Number,
    Outlier,
    Record,
    Three,
    UnidentifiableEntry,
)

_MOST = 3_000_000  # points; a damaged file may name poses and markers that fill any memory


class IdentifyNoise(NoiseEntry):
    """The noise that the standard deviations rest on, and what speaks for it."""

    replicate_sigma_mm: NotNegative | None
    lack_of_fit_p: Number
    degrees_of_freedom: Maybe = None


class Placement(Entry):
    """The base in the frame of the readings."""

    rotation_vector_rad: Three
    translation_mm: Three


class Placements(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement] = Field(default_factory=dict)


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
    parameters: tuple[IdentifiedParameter, ...] = Field(min_length=1)
    weak: tuple[str, ...]
    unused_poses: tuple[str, ...]
    before_the_first_move: tuple[str, ...] = ()
    unidentifiable: tuple[UnidentifiableEntry, ...]
    absorbed: tuple[Absorbed, ...]
    outliers: tuple[Outlier, ...]
    outliers_share: OutliersTogether | None = None
    heldout_outliers: tuple[Outlier, ...]
    rms_mm: ErrorFigures
    max_mm: ErrorFigures
    p95_mm: ErrorFigures
    instruments: tuple[OfInstrument, ...] = ()
    pair_distances_mm: dict[Model, Pairs]
    rms_of_residuals_mm: NotNegative | None
    base: Placements
    markers_mm: dict[str, Three]
    bodies: dict[str, Placement] = Field(default_factory=dict)
    correlation: tuple[tuple[Maybe, ...], ...]
    residuals: tuple[IdentifyResidual, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    targets: str
    at_targets: tuple[TargetAccuracy, ...] = Field(min_length=1)
    budget: BudgetEntry | None = None
    acceptance: AcceptanceEntry | None = None
    drift: DriftEntry | None = None
    of_type: OfType | None = None
    sizes: SizesEntry | None = None
    lenses: tuple[LensValue, ...] = ()
    unfit_lenses: tuple[UnfitLensEntry, ...] = Field(default=(), exclude_if=lambda own: not own)
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
        return BeforeAfter(before, after, unit, heldout)


_WRONG_TABLE_MM = 20.0  # no arm is so wrong, and none so well placed by guesses
_OF_TYPE = "Is it as others of its type?"
_WRONG_TABLE = (
    "The readings do not fit this robot. Check units, signs and order of the joints, and the order of "
    "the rows."
)


def told(record: IdentifyRecord) -> Document:
    """Errors before and after, what moved meanwhile, the parameters, and the accuracy elsewhere."""
    kin, lenses = record.of_type, tuple(told_lenses(record.lenses))
    workspace = Figure(lambda: over_the_workspace(record.at_targets))
    return Document(
        (_fell(record), *accepted(record.acceptance), _next(record)),
        (
            Section("errors", "Errors before and after", tuple(told_errors(record))),
            *drift_section(record),
            Section("parameters", "What was identified", tuple(told_parameters(record))),
            *([Section("lenses", "Lenses", lenses)] if record.lenses else []),
            *([] if kin is None else [Section("type", _OF_TYPE, tuple(told_of_type(kin)))]),
            Section("workspace", "Accuracy to expect elsewhere", (workspace,)),
            *budget_section(record.budget, record.targets, record.noise.missing),
        ),
    )


def _fell(record: IdentifyRecord) -> Sentence:
    before, after, unit, _ = record.error
    where = "at held-out poses" if record.held_out else "at the fitted poses"
    old, new = (mm(own) if unit == "mm" else f"{MRAD(own)} {unit}" for own in (before, after))
    if after >= before:
        return Sentence(f"The error {where} did not fall: {old} before, {new} after.", "warn")
    converged = record.status == "converged"
    praised = record.status != "not_converged" and before >= 2.0 * after > 0.0
    ratio = before / after if praised else 1.0
    times = f", {ratio:.{int(ratio < 10.0)}f} times better" * praised
    said = f"The error {where} fell from {old} to {new}{times}."
    return Sentence(said, "good" if converged else "warn")


def _next(record: IdentifyRecord) -> Sentence:
    """What speaks against the result first, else the accuracy to expect."""
    before, after, unit, _ = record.error
    if unit == "mm" and min(before, after) > _WRONG_TABLE_MM:
        return Sentence(_WRONG_TABLE, "warn")
    if record.unfit_lenses:
        return Sentence(" ".join(own.said for own in record.unfit_lenses), "warn")
    noise, lacking = record.noise, 0.0 if record.budget is None else record.budget.of("model")
    if record.status != "converged":
        status = record.status.replace("_", " ").capitalize()
        return Sentence(f"{status}: {record.advice}.", "warn")
    if lacking:
        said = lacks(lacking)
        return Sentence(f"{said[0].upper()}{said[1:]}.", "warn")
    if after >= before and not record.noise.lacks and record.lenses:
        return Sentence(
            "The nominal arm is as good: the lens that was found is the result.", "good"
        )
    if after >= before and not record.noise.lacks:
        return Sentence("The nominal model is as good: there is nothing to correct.")
    if after >= before:
        said = "Do not use this model. Measure more poses, or identify fewer parameters."
        return Sentence(said, "warn")
    if noise.louder and not noise.scatters:
        return Sentence(
            f"{mm(noise.sigma_mm)} remains in each coordinate; the cell states "
            f"{mm(noise.believed_sigma_mm)}. Run `posecal diagnose`.",
            "warn",
        )
    if (scatters := unusual(noise)) is not None:
        return Sentence(scatters, "warn")
    rms, worst = mm(record.task_rms_mm), mm(record.task_worst_mm)
    only = ", if the model lacks nothing" if noise.missing else ""
    return Sentence(
        f"The parameters' uncertainty leaves {rms} RMS at the targets, {worst} at worst{only}."
    )
