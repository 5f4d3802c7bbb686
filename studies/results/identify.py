"""``identify --json``: the parameters, how sure they are, and the errors before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

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
    tuples,
)
from studies.results.estimate import Estimated, Lengths, Pixels, Residual, outliers
from studies.results.noise import IdentifyNoise
from studies.results.parts import ParameterStd

if TYPE_CHECKING:
    from calib import Cell, Identification, Measurements
    from calib.arrays import Array
    from calib.identification import Residuals
    from calib.inference.widths import Widths
    from calib.instruments import Camera
    from calib.prediction.budget import Budget, UncertaintySource

_TOGETHER = 0.9  # correlation that is listed
_LENS_IN_PX = 4  # values of a lens in pixels, the first
Part = Literal["nominal", "fitted_all", "fitted", "heldout", "heldout_trimmed"]


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
        intervals = tuples(result.interval() / scales[:, None])
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
        from calib.instruments import Camera

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
    from calib.effects.base import Base
    from calib.effects.lens import LensEffect

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


class PairErrors(Entry):
    """Errors of the distances between points of two poses, mm."""

    rms: NotNegative
    p95: NotNegative
    max: NotNegative
    pairs: Count

    @classmethod
    def each(cls, result: Identification) -> Iterator[tuple[Part, Self]]:
        """By model; of trackers alone, since nothing else reads where a point is."""
        from calib.identification.residuals import pair_errors
        from calib.instruments import Tracker

        if not all(isinstance(i, Tracker) for i in result.model.instruments):
            return
        fit, held = result.fit, result.heldout
        nominal = result.model.predict(result.nominal, fit.data.poses)[..., :3]
        parts: list[tuple[Part, Measurements, Array]] = [
            ("nominal", fit.data, nominal),
            ("fitted", fit.data, fit.data.points - fit.vectors[..., :3]),
        ]
        if held is not None:
            parts.append(("heldout", held.data, held.data.points - held.vectors[..., :3]))
        for key, data, predicted in parts:
            errors = np.abs(pair_errors(data, predicted)) * MM
            if len(errors):
                p95, most = np.quantile(errors, (0.95, 1.0))
                yield key, cls(rms=rms(errors), p95=p95, max=most, pairs=len(errors))


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


# -- uncertainty -------------------------------------------------------------------------------


class BudgetRow(Entry):
    """One source at the targets, RMS over their points and over them.

    standard_uncertainty : in ``unit``, None where the source has none of its own
    sensitivity_mm : at the targets by one ``unit``
    at_one_reading_mm : by one standard uncertainty; base_placed_anew_mm : at the targets, without what
        moves them as one
    share : of the variance in the total; degrees_of_freedom : None where it counts as known
    """

    source: str
    evaluation: Literal["A", "B"]
    part_of: Literal["calibration", "arm", "model"]
    standard_uncertainty: Maybe
    unit: str
    sensitivity_mm: Maybe
    degrees_of_freedom: Maybe
    at_one_reading_mm: Maybe
    at_targets_mm: NotNegative
    base_placed_anew_mm: NotNegative
    share: NotNegative

    @classmethod
    def of(cls, budget: Budget, part: UncertaintySource, total: float) -> Self:
        """The row of a source; total : variance of all, mm^2."""
        targets, anew = budget.rms(part.errors) * MM, budget.placed_anew(part) * MM
        reading = None if part.at_reading is None else part.at_reading * MM
        std = None if part.std is None else part.std * MM
        return cls(
            source=part.source,
            evaluation=part.evaluation,
            part_of=part.of,
            standard_uncertainty=std,
            unit="" if std is None else "mm",
            sensitivity_mm=targets / std if std else None,
            degrees_of_freedom=part.freedom,
            at_one_reading_mm=reading,
            at_targets_mm=targets,
            base_placed_anew_mm=anew,
            share=targets**2 / total if total else 0.0,
        )


class ExpandedUncertainty(Entry):
    """A combined standard uncertainty, and the distance within which 95 % of errors stay.

    Errors in space: the factor is Student's t where they lie along one line, less where not.
    """

    standard_uncertainty_mm: NotNegative
    coverage_factor: Positive
    expanded_mm: NotNegative
    worst_expanded_mm: NotNegative
    degrees_of_freedom: Maybe

    @classmethod
    def of(cls, budget: Budget, parts: Sequence[UncertaintySource]) -> Self:
        """Several sources together."""
        from calib.prediction.budget import combined

        both = combined(parts, budget.weights)
        u, most = budget.rms(both.errors), budget.rms(both.expanded)
        return cls(
            standard_uncertainty_mm=u * MM,
            coverage_factor=most / u if u else 1.0,
            expanded_mm=most * MM,
            worst_expanded_mm=budget.worst(both.expanded) * MM,
            degrees_of_freedom=both.freedom,
        )


class UncertaintyBudget(Entry):
    """All sources; what the parameters' uncertainty leaves, and with what the arm itself adds."""

    rows: tuple[BudgetRow, ...] = Field(min_length=1)
    calibration: ExpandedUncertainty
    total: ExpandedUncertainty
    probability: Positive

    @classmethod
    def of(cls, budget: Budget) -> Self:
        """The entry of a budget."""
        from calib.inference.coverage import LEVEL

        total = ExpandedUncertainty.of(budget, budget.parts)
        square = total.standard_uncertainty_mm**2
        return cls(
            rows=tuple(BudgetRow.of(budget, part, square) for part in budget.parts),
            calibration=ExpandedUncertainty.of(budget, budget.calibration),
            total=total,
            probability=LEVEL,
        )

    def part(self, name: str) -> float:
        """What all rows of one part do at the targets, mm."""
        return math.hypot(*(row.at_targets_mm for row in self.rows if row.part_of == name))


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
        from calib.arm.se3 import so3_exp, so3_log

        turned = so3_log(so3_exp(placed[3:]))  # at most half a turn
        return cls(
            rotation_vector_rad=tuples(turned), translation_mm=tuples(placed[:3] * MM), **more
        )


class Placements(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement]


def _bodies(result: Identification) -> Iterator[tuple[str, Placement]]:
    from calib.instruments import Pose

    for instrument in result.model.instruments:
        if isinstance(instrument, Pose):
            for at, body in instrument.bodies(result.marker_positions):
                yield result.model.marker_names[at], Placement.of(np.concatenate(body))


class IdentifyResult(Result):
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
    poses: Count
    points: Count
    rank: Count
    degrees_of_freedom: Count
    iterations: Count
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
    pair_distances_mm: dict[Part, PairErrors]
    rms_of_residuals_mm: NotNegative | None
    base: Placements
    markers_mm: dict[str, Three]
    bodies: dict[str, Placement]
    correlation: tuple[tuple[Maybe, ...], ...]
    residuals: tuple[IdentifyResidual, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    targets: str
    budget: UncertaintyBudget
    acceptance: Acceptance | None
    drift_p: Maybe
    sizes: SizePrior | None
    lenses: tuple[LensValue, ...]
    estimate: Estimated

    @classmethod
    def of(
        cls,
        result: Identification,
        cell: Cell,
        whole: Measurements,
        made_from: Envelope,
        **asked: Any,
    ) -> Self:
        """The result of an identification of a cell.

        whole : all readings of the table; asked : weighting, length_mm, holdout, warnings
        """
        from calib.identification import ADVICE
        from calib.identification.drift import drift_p
        from calib.prediction.budget import accuracy_at_targets
        from calib.prediction.estimate import estimate_of

        model, fit, held, noise = result.model, result.fit, result.heldout, result.noise
        estimate = estimate_of(result, cell.design.targets_after or 0.0)
        accuracy = accuracy_at_targets(cell, result, estimate)
        tracked, again = model.tracked(whole), noise.replicate_factor
        bases = {where: Placement.of(placed) for where, placed in result.bases.items()}
        first = next(iter(result.bases.values()), np.zeros(6))
        read: list[int] = np.unique(model.readout.channels.marker).tolist()
        return cls(
            **made_from,
            **asked,
            status=result.status,
            advice=ADVICE[result.status],
            approach=result.approach,
            method=result.method,
            noise=IdentifyNoise.of(
                noise,
                result.levels,
                result.scatter,
                model,
                result.footprint,
                replicate_sigma_mm=again and again * noise.believed * result.footprint * MM,
                lack_of_fit_p=noise.lack_of_fit_p,
                degrees_of_freedom=noise.dof,
            ),
            poses=len(fit.data),
            points=int(fit.data.seen.sum()),
            rank=result.rank,
            degrees_of_freedom=result.dof,
            iterations=result.iterations,
            parameters=Parameter.of(result),
            weak=result.weak,
            unused_poses=(*result.unused, *result.waiting),
            before_the_first_move=result.waiting,
            unidentifiable=tuple(
                Unidentifiable(names=lost.names, reason=lost.reason)
                for lost in result.unidentifiable
            ),
            absorbed=tuple(
                Redundant(id=lost.id, absorbed_by=tuple(name for name, _ in lost.absorbed_by))
                for lost in result.absorbed
                if lost.absorbed_by
            ),
            outliers=tuple(outliers(fit, model, result.footprint)),
            heldout_outliers=() if held is None else tuple(outliers(held, model, result.footprint)),
            rms_mm=ErrorFigures.of(result, rms),
            max_mm=ErrorFigures.of(result, np.max),
            p95_mm=ErrorFigures.of(result, lambda d: float(np.quantile(d, 0.95))),
            instruments=tuple(
                InstrumentErrors.model_validate({"instrument": name, "unit": unit, **errors})
                for (name, unit), errors in result.by_instrument.items()
            ),
            pair_distances_mm=dict(PairErrors.each(result)),
            rms_of_residuals_mm=rms(fit.lengths()) * MM if fit.channels.metric else None,
            base=Placements.of(first, stations=bases if len(bases) > 1 else {}),
            markers_mm={
                model.marker_names[j]: tuples(result.marker_positions[j] * MM) for j in read
            },
            bodies=dict(_bodies(result)),
            correlation=tuples(np.round(result.correlation, 4)),
            residuals=tuple(
                row
                for part in (fit, held)
                if part is not None
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
            targets=accuracy.source,
            budget=UncertaintyBudget.of(accuracy),
            acceptance=Acceptance.of(cell.tolerance, held) if cell.tolerance is not None else None,
            drift_p=None if tracked is None else drift_p(tracked[1]),
            sizes=None if result.sizes is None else SizePrior.of(result.sizes),
            lenses=tuple(LensValue.each(result)),
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
        before, after = (
            rms([math.hypot(*vector) for vector in vectors])
            for vectors in ([row.before for row in rows], [row.vector for row in rows])
        )
        judged = None if self.acceptance is None else self.acceptance.judgement
        return BeforeAfter(before, after, "RMS error at {where}", unit, heldout, judged=judged)

    @cached_property
    def by_pose(self) -> tuple[PoseError, ...]:
        """The errors that are lengths, pose by pose."""
        rows: dict[tuple[str, bool], list[IdentifyResidual]] = {}
        for row in self.residuals:
            if row.metric:
                rows.setdefault((row.pose, row.heldout), []).append(row)
        return tuple(
            PoseError(
                pose,
                rms([math.hypot(*row.before) for row in readings]),
                rms([math.hypot(*row.vector) for row in readings]),
                len(readings),
                held,
            )
            for (pose, held), readings in rows.items()
        )

    @property
    def nominal_heldout_mm(self) -> tuple[float, float, float] | None:
        """RMS, 95th percentile and maximum of the nominal model at held-out points."""
        rows = [row for row in self.residuals if row.heldout and row.metric]
        if not rows:
            return None
        lengths = [math.hypot(*row.before) for row in rows]
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
