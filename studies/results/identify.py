"""``identify --json``: the parameters, how sure they are, and the errors before and after."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from calib import Cell, Identification, Measurements
from calib.arm.se3 import so3_exp, so3_log
from calib.arrays import Array
from calib.effects.camera import LensEffect
from calib.effects.tool_base import Base
from calib.identification import Residuals
from calib.identification.drift import drift_p
from calib.inference.widths import Widths
from calib.instruments import Camera, Pose
from calib.prediction.budget import accuracy_at_targets
from calib.prediction.estimate import estimate_of
from studies.results.base import (
    MM,
    BeforeAfter,
    Count,
    Entry,
    Envelope,
    Judgement,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Outlier,
    Positive,
    Result,
    Three,
    Unit,
)
from studies.results.estimate import Estimated, Lengths, Pixels, Residual, outliers
from studies.results.expected import ExpectedErrors, UncertaintyBudget
from studies.results.noise import Noise
from studies.results.parts import Conditions, ParameterStd

_TOGETHER = 0.9  # correlation that is listed
_LENS_IN_PX = 4  # values of a lens in pixels, the first


# -- parameters --------------------------------------------------------------------------------


class Parameter(ParameterStd):
    """An identified value; std, ci95, degrees_of_freedom are None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    """

    value: Number
    ci95: tuple[Number, Number] | None
    degrees_of_freedom: Maybe

    @classmethod
    def of(cls, result: Identification) -> tuple[Self, ...]:
        """All parameters in the order of the model."""
        scales = np.array([p.scale for p in result.model.parameters])
        known = (result.std > 0.0) & np.isfinite(result.std)
        intervals = (result.interval() / scales[:, None]).tolist()
        return cls.known(
            result.model.parameters,
            np.where(known, result.std, np.nan),
            value=result.values / scales,
            ci95=[ci if k else None for ci, k in zip(intervals, known, strict=True)],
            degrees_of_freedom=np.where(known, result.freedoms, np.nan),
        )


class Redundant(Entry):
    """A constant for which others stand at any pose."""

    id: str
    absorbed_by: tuple[str, ...]


class Unidentifiable(Entry):
    """Parameters that the poses do not determine."""

    names: tuple[str, ...]
    reason: str


class SizeOfErrors(Entry):
    """Standard deviation, between such errors, of those of one effect that have one unit."""

    effect: str
    width: Positive
    unit: str


class SizePrior(Entry):
    """What holds the values that the readings leave open.

    parameters : how many of them it determines in place of the readings
    """

    parameters: Positive
    widths: tuple[SizeOfErrors, ...]

    @classmethod
    def of(cls, sizes: Widths) -> Self:
        """The entry of the widths of an identification."""
        each = zip(sizes.of.classes, sizes.widths / sizes.of.scales, strict=True)
        widths = (SizeOfErrors(effect=kind[0], unit=kind[1], width=width) for kind, width in each)
        return cls(parameters=sizes.saved, widths=tuple(widths))


class LensValue(Entry):
    """A value of a camera's lens as the cell gives it, and as identified; std None: not estimated."""

    camera: str
    name: str
    nominal: Number
    value: Number
    std: MaybePositive
    unit: str

    @classmethod
    def each(cls, result: Identification) -> Iterator[Self]:
        """All values of the lenses of which anything was identified."""
        for camera in result.model.readout.channels.instruments:
            if not isinstance(camera, Camera):
                continue
            by = _lens_by_parameters(result, camera)
            values = camera.lens.values + by @ result.values
            std = np.sqrt(np.diag(by @ result.covariance @ by.T))
            for i, name in enumerate(camera.lens.names if by.any() else ()):
                yield cls(
                    camera=camera.name,
                    name=name,
                    nominal=camera.lens.values[i],
                    value=values[i],
                    std=std[i] if std[i] > 0.0 else None,
                    unit="px" if i < _LENS_IN_PX else "1",
                )


def _lens_by_parameters(result: Identification, camera: Camera) -> Array:
    """Derivatives of a lens's values by the parameters, shape (n, p)."""
    by = np.zeros((len(camera.lens.values), len(result.values)))
    for effect, part in result.model.parts:
        if isinstance(effect, Base) and effect.of.name == camera.name:
            by[camera.free, np.arange(part.stop - len(camera.free), part.stop)] = 1.0
        elif isinstance(effect, LensEffect) and effect.changes(camera):
            by[effect.values, part] = np.eye(part.stop - part.start)
    return by


# -- errors ------------------------------------------------------------------------------------


class ErrorFigures(Entry):
    """A statistic of the distances between measured and predicted points.

    nominal : base and markers fitted; fitted : without the outliers; None where there is no point, and
        everywhere where no reading is a length
    """

    nominal: NotNegative | None = None
    fitted_all: NotNegative | None = None
    fitted: NotNegative | None = None
    heldout: NotNegative | None = None
    heldout_trimmed: NotNegative | None = None

    @classmethod
    def of(cls, result: Identification, statistic: Callable[[Array], float]) -> Self:
        """The statistic of each part."""
        known = result.distances if result.fit.channels.metric else {}
        return cls(**{key: statistic(d) * MM for key, d in known.items() if len(d)})


class InstrumentErrors(ErrorFigures):
    """RMS of an instrument's errors in one unit: lengths in space, and of whole poses their turns."""

    instrument: str
    unit: Unit


class IdentifyResidual(Residual):
    """Measured minus predicted reading, by the identified and by the nominal model.

    Of a point in the instrument's frame, of one that touches a socket in the base's; of a body's pose
    in its own, turns beside it; of what reads one length that alone, d; of a camera's reading in the
    image.
    """

    other = "nominal"
    rx_mrad: Maybe = None
    ry_mrad: Maybe = None
    rz_mrad: Maybe = None
    nominal_mm: Lengths | None = None
    nominal_px: Pixels | None = None
    nominal_mrad: Three | None = None


def rms(values: Array | Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


class PoseError(NamedTuple):
    """RMS error of a pose over its points, mm; heldout : whether it took no part in the fit."""

    pose: str
    before: float
    after: float
    points: int
    heldout: bool


# -- tolerance ---------------------------------------------------------------------------------


class Acceptance(Entry):
    """Whether every held-out point is within the tolerance; None where no point is held out."""

    tolerance_mm: Positive
    verdict: Literal["pass", "fail"] | None
    largest_mm: NotNegative | None

    @classmethod
    def of(cls, tolerance: float, held: Residuals | None) -> Self:
        """The verdict; tolerance : m."""
        lengths = () if held is None else held.lengths()
        largest = float(max(lengths)) if len(lengths) else None
        passes = largest is not None and largest <= tolerance
        return cls(
            tolerance_mm=tolerance * MM,
            verdict=None if largest is None else "pass" if passes else "fail",
            largest_mm=None if largest is None else largest * MM,
        )

    @property
    def judgement(self) -> Judgement:
        """The verdict and what it rests on."""
        by = f"tolerance {self.tolerance_mm:g} mm: "
        if self.verdict is None:
            return Judgement("not decided", f"{by}no poses are held out; add --holdout 0.3")
        largest = f"the largest error of held-out points is {self.largest_mm:.3g} mm"
        return Judgement(self.verdict, by + largest)


# -- places ------------------------------------------------------------------------------------


class Placement(Entry):
    """A frame, such as the base, in the frame of the readings."""

    rotation_vector_rad: Three
    translation_mm: Three

    @classmethod
    def of(cls, placed: Array, **more: Any) -> Self:
        """A placement of translation and rotation vector, shape (6,), m and rad."""
        turned = so3_log(so3_exp(placed[3:]))  # at most half a turn
        return cls(
            rotation_vector_rad=turned.tolist(), translation_mm=(placed[:3] * MM).tolist(), **more
        )


class Placements(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement]


def _bodies(result: Identification) -> Iterator[tuple[str, Placement]]:
    for instrument in result.model.instruments:
        if isinstance(instrument, Pose):
            for at, body in instrument.bodies(result.marker_positions):
                yield result.model.marker_names[at], Placement.of(np.concatenate(body))


class IdentifyResult(Result):
    """The identified parameters, how sure they are, and what they leave."""

    command: Literal["identify"] = "identify"
    weighting: Literal["full", "normalised", "plain"] | None = None
    length_mm: Maybe = None
    holdout: str | None = None
    status: Literal["converged", "not_converged", "rank_deficient"]
    approach: Literal["points", "pose"]
    method: Literal["joint", "two-step"]
    noise: Noise
    poses: Count
    points: Count
    rank: Count
    degrees_of_freedom: Count
    parameters: tuple[Parameter, ...] = Field(min_length=1)
    weak: tuple[str, ...]
    unused_poses: tuple[str, ...]
    before_the_first_move: tuple[str, ...]
    unidentifiable: tuple[Unidentifiable, ...]
    absorbed: tuple[Redundant, ...]
    outliers: tuple[Outlier, ...]
    heldout_outliers: tuple[Outlier, ...]
    rms_mm: ErrorFigures
    max_mm: ErrorFigures
    p95_mm: ErrorFigures
    instruments: tuple[InstrumentErrors, ...]
    base: Placements
    markers_mm: dict[str, Three]
    bodies: dict[str, Placement]
    correlation: tuple[tuple[Maybe, ...], ...]
    residuals: tuple[IdentifyResidual, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    expected: ExpectedErrors
    targets: str
    budget: UncertaintyBudget
    acceptance: Acceptance | None
    drift_p: Maybe
    sizes: SizePrior | None
    lenses: tuple[LensValue, ...]
    conditions: tuple[Conditions, ...]
    estimate: Estimated

    @classmethod
    def of(
        cls,
        result: Identification,
        cell: Cell,
        made_from: Envelope,
        *,
        whole: Measurements | None = None,
        warnings: Iterable[str] = (),
        **asked: Any,
    ) -> Self:
        """The result of an identification of a cell.

        whole : all readings of the table, held-out ones too; asked : weighting, length_mm, holdout
        warnings : of the data
        """
        model, fit, held, noise = result.model, result.fit, result.heldout, result.noise
        estimate = estimate_of(result, cell.design.targets_after or 0.0)
        accuracy = accuracy_at_targets(cell, result, estimate)
        tracked = model.tracked(fit.data if whole is None else whole)
        bases = {where: Placement.of(placed) for where, placed in result.bases.items()}
        first = next(iter(result.bases.values()), np.zeros(6))
        parts = [part for part in (fit, held) if part is not None]
        read: list[int] = np.unique(model.readout.channels.marker).tolist()
        return cls.from_object(
            result,
            **made_from,
            **asked,
            warnings=(*warnings, *result.warnings),
            noise=Noise.of(noise, result.levels, result.scatter, model, result.footprint),
            poses=len(fit.data),
            points=int(fit.data.seen.sum()),
            degrees_of_freedom=result.dof,
            parameters=Parameter.of(result),
            unused_poses=(*result.unused, *result.waiting),
            before_the_first_move=result.waiting,
            unidentifiable=tuple(map(Unidentifiable.from_object, result.unidentifiable)),
            absorbed=tuple(
                Redundant(id=lost.id, absorbed_by=tuple(name for name, _ in lost.absorbed_by))
                for lost in result.absorbed
                if lost.absorbed_by
            ),
            outliers=tuple(outliers(fit, result.footprint)),
            heldout_outliers=() if held is None else tuple(outliers(held, result.footprint)),
            rms_mm=ErrorFigures.of(result, rms),
            max_mm=ErrorFigures.of(result, np.max),
            p95_mm=ErrorFigures.of(result, lambda d: float(np.quantile(d, 0.95))),
            instruments=tuple(
                InstrumentErrors.model_validate({"instrument": name, "unit": unit, **errors})
                for (name, unit), errors in result.by_instrument.items()
            ),
            base=Placements.of(first, stations=bases if len(bases) > 1 else {}),
            markers_mm={
                model.marker_names[j]: (result.marker_positions[j] * MM).tolist() for j in read
            },
            bodies=dict(_bodies(result)),
            correlation=np.round(result.correlation, 4).tolist(),
            residuals=tuple(
                row
                for part in parts
                for row in IdentifyResidual.each(
                    model,
                    part.data,
                    model.off(result.nominal, part.data),
                    part.vectors,
                    part is held,
                )
            ),
            task_rms_mm=accuracy.rms(accuracy.expected.errors) * MM,
            task_worst_mm=accuracy.worst(accuracy.expected.errors) * MM,
            expected=ExpectedErrors.at_targets(cell, estimate),
            targets=cell.targets_in_words,
            budget=UncertaintyBudget.of(accuracy),
            acceptance=Acceptance.of(cell.tolerance, held) if cell.tolerance is not None else None,
            drift_p=None if tracked is None else drift_p(tracked[1]),
            sizes=None if result.sizes is None else SizePrior.of(result.sizes),
            lenses=tuple(LensValue.each(result)),
            conditions=tuple(
                row
                for part in parts
                for row in Conditions.each(model.robot, part.data, part is held)
            ),
            estimate=Estimated.of(estimate),
        )

    @cached_property
    def error(self) -> BeforeAfter:
        """RMS by the nominal and by the identified model, held out where anything was.

        In space; where no reading is a length, of the instrument that is predicted worst.
        """
        heldout = any(row.heldout for row in self.residuals)
        rows, unit = [row for row in self.residuals if row.heldout == heldout], "mm"
        if any(row.metric for row in rows):
            rows = [row for row in rows if row.metric]
        else:
            worst = max(
                self.instruments, key=lambda errors: errors.heldout or errors.fitted_all or 0.0
            )
            rows, unit = [row for row in rows if row.instrument == worst.instrument], worst.unit
        before, after = map(rms, zip(*(row.lengths for row in rows), strict=True))
        judged = None if self.acceptance is None else self.acceptance.judgement
        return BeforeAfter(before, after, "RMS error at {where}", unit, heldout, judged=judged)

    @cached_property
    def by_pose(self) -> tuple[PoseError, ...]:
        """The errors that are lengths, pose by pose."""
        rows: dict[tuple[str, bool], list[IdentifyResidual]] = {}
        for row in self.residuals:
            if row.metric:
                rows.setdefault((row.pose, row.heldout), []).append(row)
        found = []
        for (pose, held), own in rows.items():
            before, after = map(rms, zip(*(row.lengths for row in own), strict=True))
            found.append(PoseError(pose, before, after, len(own), held))
        return tuple(found)

    @property
    def main_table(self) -> tuple[Parameter, ...]:
        return self.parameters

    @property
    def nominal_heldout_mm(self) -> tuple[float, float, float] | None:
        """RMS, 95th percentile and maximum of the nominal model at held-out points."""
        rows = [row for row in self.residuals if row.heldout and row.metric]
        if not rows:
            return None
        lengths = [row.lengths[0] for row in rows]
        return rms(lengths), float(np.quantile(lengths, 0.95)), max(lengths)

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of the robot's parameters that the data hardly separate, the closest first."""
        robot = [i for i, p in enumerate(self.parameters) if not p.placed and p.std]
        pairs = (
            (self.parameters[a].id, self.parameters[b].id, self.correlation[a][b] or 0.0)
            for n, a in enumerate(robot)
            for b in robot[n + 1 :]
        )
        return sorted((p for p in pairs if abs(p[2]) > _TOGETHER), key=lambda p: -abs(p[2]))
