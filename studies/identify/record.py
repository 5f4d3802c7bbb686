"""What ``posecal identify`` finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, TypedDict

import numpy as np
from pydantic import Field, computed_field, model_validator

from studies.estimate import Estimated, estimated
from studies.identify.acceptance import AcceptanceEntry, acceptance_entry
from studies.identify.budget import BudgetEntry, budget_entry
from studies.identify.drift import Drift, drift_entry
from studies.identify.of_type import OfType, of_type_entry
from studies.noise import Noise, by_level
from studies.record import (
    Count,
    Entry,
    Envelope,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Record,
    Three,
    three,
)
from studies.residual import Angles, Lengths, Off, Pixels, missed
from studies.targets import AtTarget, at_targets

if TYPE_CHECKING:
    from calib import Identification
    from calib.accuracy.acceptance import Judged
    from calib.accuracy.at_targets import Accuracy
    from calib.arrays import Array
    from calib.compensation.estimate import Estimate
    from calib.drift import Drift as Moved
    from calib.identification import Residuals
    from calib.identification.common import Shared

_MM = 1e3
_MOST = 3_000_000  # points; a damaged file may name poses and markers that fill any memory
_PLACED = ("base", "tool")


class IdentifyNoise(Noise):
    """The noise that the standard deviations rest on, and what speaks for it."""

    replicate_sigma_mm: NotNegative | None
    lack_of_fit_p: Number
    degrees_of_freedom: Maybe = None


class Parameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    std_by_pose : if the points of a pose err together, as under a model that lacks something
    step_two_optimism : factor by which it would be less if base and tool were known
    """

    id: str
    name: str
    effect: str
    where: str
    value: Number
    std: MaybePositive
    ci95: tuple[Number, Number] | None
    degrees_of_freedom: Maybe = None
    std_by_pose: Maybe
    step_two_optimism: Maybe
    unit: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in _PLACED


class Unidentifiable(Entry):
    """Parameters that the poses do not determine."""

    names: tuple[str, ...]
    reason: str


class Absorbed(Entry):
    """A constant that others stand for at any pose."""

    id: str
    absorbed_by: tuple[str, ...]


class Outlier(Entry):
    """A pose that stands out."""

    pose: str
    reason: str


class Share(Entry):
    """What the outliers have in common, in the unit that it names."""

    variable: str
    low: Number
    high: Number
    unit: str
    poses: Count
    of_poses: Count
    outliers: Count
    of_outliers: Count
    p: Number
    beyond_all_others: Maybe


class Distances(Entry):
    """A figure over the distances between measured and predicted points.

    nominal : base and markers fitted; fitted : without the outliers; None where there is no point, and
        everywhere where no reading is a length
    """

    nominal: NotNegative | None
    fitted_all: NotNegative | None
    fitted: NotNegative | None
    heldout: NotNegative | None
    heldout_trimmed: NotNegative | None


class OfInstrument(Entry):
    """RMS of an instrument's errors in one unit: lengths in space, and of whole poses their turns.

    The JSON holds them once more together, as ``rms``.
    """

    instrument: str
    unit: Literal["mm", "mrad", "px"]
    nominal: NotNegative | None = None
    fitted_all: NotNegative | None = None
    fitted: NotNegative | None = None
    heldout: NotNegative | None = None
    heldout_trimmed: NotNegative | None = None

    @model_validator(mode="before")
    @classmethod
    def _told_once(cls, raw: object) -> object:
        if not isinstance(raw, dict):
            return raw  # which is refused as any other fault
        return {name: value for name, value in raw.items() if name != "rms"}

    @computed_field  # type: ignore[prop-decorator]
    @property
    def rms(self) -> dict[str, str | float | None]:
        """All of the entry."""
        return {name: getattr(self, name) for name in type(self).model_fields}


Model: TypeAlias = Literal["nominal", "fitted_all", "fitted", "heldout", "heldout_trimmed"]


class Pairs(Entry):
    """Errors of the distances between points of two poses, mm."""

    rms: NotNegative
    p95: NotNegative
    max: NotNegative
    pairs: Count


class Placement(Entry):
    """The base in the frame of the readings."""

    rotation_vector_rad: Three
    translation_mm: Three


class Base(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement] = Field(default_factory=dict)


class Residual(Off):
    """Measured minus predicted reading, by the identified and by the nominal model.

    Of a point in the instrument's frame, of one that touches a socket in the base's; of a body's pose
    in its own, turns beside it; of what reads one length that alone, d; of a camera's reading in the
    image, ``at_px`` where it was measured.
    """

    rx_mrad: Maybe = None
    ry_mrad: Maybe = None
    rz_mrad: Maybe = None
    nominal_mm: Lengths | None = None
    nominal_px: Pixels | None = None
    at_px: Pixels | None = None
    nominal_mrad: Three | Angles | None = None

    @property
    def before(self) -> tuple[float, ...]:
        """The residual of the nominal model."""
        alone = () if self.metric else self.nominal_mrad
        return self.nominal_mm or self.nominal_px or alone or ()


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
    accuracy: Accuracy,
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
        parameters=tuple(_parameters(found)),
        weak=found.weak,
        unused_poses=(*found.unused, *found.waiting),
        before_the_first_move=found.waiting,
        unidentifiable=tuple(
            Unidentifiable(names=u.names, reason=u.reason) for u in found.unidentifiable
        ),
        absorbed=_absorbed(found),
        outliers=tuple(_outliers(fit, found.footprint)),
        outliers_share=_share(found.shared),
        heldout_outliers=() if held is None else tuple(_outliers(held, found.footprint)),
        rms_mm=_distances(found, _rms),
        max_mm=_distances(found, lambda d: float(d.max())),
        p95_mm=_distances(found, lambda d: float(np.quantile(d, 0.95))),
        instruments=_instruments(found),
        pair_distances_mm=dict(_pairs(found)),
        rms_of_residuals_mm=_rms(fit.lengths()) * _MM if fit.channels.metric else None,
        base=_base(found),
        markers_mm=_markers(found),
        bodies=_bodies(found),
        correlation=tuple(map(tuple, np.round(found.correlation, 4).tolist())),
        residuals=(*_residuals(found, fit), *(() if held is None else _residuals(found, held))),
        task_rms_mm=accuracy.rms * _MM,
        task_worst_mm=accuracy.worst * _MM,
        targets=accuracy.source,
        at_targets=at_targets(
            found.model.robot, accuracy.targets, accuracy.errors, accuracy.expected.expanded
        ),
        budget=budget_entry(accuracy.budget),
        acceptance=acceptance_entry(judged),
        drift=None if drift is None else drift_entry(drift),
        of_type=None if found.of_type is None else of_type_entry(found),
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
        **by_level(found.levels, found.scatter),
    )


def _absorbed(found: Identification) -> tuple[Absorbed, ...]:
    return tuple(
        Absorbed(id=d.id, absorbed_by=tuple(name for name, _ in d.absorbed_by))
        for d in found.absorbed
    )


def _instruments(found: Identification) -> tuple[OfInstrument, ...]:
    return tuple(
        OfInstrument.model_validate({"instrument": name, "unit": unit, **rms})
        for (name, unit), rms in found.by_instrument.items()
    )


def _rms(distances: Array) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def _markers(found: Identification) -> dict[str, tuple[float, float, float]]:
    """Those that are read by their names."""
    model = found.model
    read: list[int] = np.unique(model.readout.channels.marker).tolist()
    return {model.marker_names[j]: three(found.marker_positions[j] * _MM) for j in read}


def _parameters(found: Identification) -> Iterator[Parameter]:
    by_pose = np.full(len(found.values), np.nan) if found.std_by_pose is None else found.std_by_pose
    for p, value, std, (low, high), dof, own, factor in zip(
        found.model.parameters, found.values.tolist(), found.std.tolist(),
        found.interval().tolist(), found.freedoms.tolist(), by_pose.tolist(),
        found.optimism.tolist(), strict=True,
    ):  # fmt: skip
        known = 0.0 < std < np.inf
        yield Parameter(
            id=p.id,
            name=p.name,
            effect=p.effect,
            where=p.where,
            value=value / p.scale,
            std=std / p.scale if known else None,
            ci95=(low / p.scale, high / p.scale) if known else None,
            degrees_of_freedom=dof if known else None,
            std_by_pose=own / p.scale,
            step_two_optimism=factor,
            unit=p.unit,
        )


def _outliers(part: Residuals, footprint: float) -> Iterator[Outlier]:
    for i in np.flatnonzero(part.outlier):
        errors = np.where(part.channels.lengths, part.vectors[i], 0.0)
        largest = float(np.linalg.norm(errors, axis=-1).max()) * footprint * _MM
        ratio = float(np.sqrt(part.statistic[i] / part.limit))
        yield Outlier(
            pose=part.data.poses.names[i],
            reason=f"residual up to {largest:.3f} mm, {ratio:.1f} times what the other poses allow",
        )


def _share(common: Shared | None) -> Share | None:
    if common is None:
        return None
    return Share(
        variable=common.variable,
        low=common.low / common.scale,
        high=common.high / common.scale,
        unit=common.unit,
        poses=common.inside,
        of_poses=common.poses,
        outliers=common.outliers,
        of_outliers=common.of,
        p=common.p,
        beyond_all_others=common.alone / common.scale if common.alone else None,
    )


def _distances(found: Identification, figure: Callable[[Array], float]) -> Distances:
    """Nothing where no reading is a length."""
    metric = found.fit.channels.metric
    known = {key: figure(d) * _MM for key, d in found.distances.items() if metric and len(d)}
    return Distances.model_validate({key: known.get(key) for key in Distances.model_fields})


def _pairs(found: Identification) -> Iterator[tuple[Model, Pairs]]:
    from calib.identification.pairs import pair_errors
    from calib.instruments import Tracker

    fit, held = found.fit, found.heldout
    if not all(isinstance(i, Tracker) for i in found.model.instruments):
        return  # nothing else reads where a point is
    nominal = found.model.predict(found.nominal, fit.data.poses)[..., :3]
    parts: list[tuple[Model, Array]] = [
        ("nominal", pair_errors(fit.data, nominal)),
        ("fitted", pair_errors(fit.data, fit.data.points - fit.vectors[..., :3])),
    ]
    if held is not None:
        parts.append(("heldout", pair_errors(held.data, held.data.points - held.vectors[..., :3])))
    for key, errors in parts:
        if len(errors):
            yield (
                key,
                Pairs(
                    rms=float(np.sqrt(np.mean(errors**2))) * _MM,
                    p95=float(np.quantile(np.abs(errors), 0.95)) * _MM,
                    max=float(np.abs(errors).max()) * _MM,
                    pairs=len(errors),
                ),
            )


def _base(found: Identification) -> Base:
    stations = {where: _placement(placed) for where, placed in found.bases.items()}
    first = next(iter(stations.values()), _placement(np.zeros(6)))
    return Base(**first.model_dump(), stations=stations if len(stations) > 1 else {})


def _bodies(found: Identification) -> dict[str, Placement]:
    """Each body's frame in the tip's."""
    from calib.instruments import Pose

    return {
        found.model.marker_names[first]: _placement(np.concatenate(body))
        for i in found.model.instruments
        if isinstance(i, Pose)
        for first, body in i.bodies(found.marker_positions)
    }


def _placement(placed: Array) -> Placement:
    from calib.arm.se3 import so3_exp, so3_log

    return Placement(
        rotation_vector_rad=three(so3_log(so3_exp(placed[3:]))),
        translation_mm=three(placed[:3] * _MM),
    )


def _residuals(found: Identification, part: Residuals) -> Iterator[Residual]:
    nominal = found.model.off(found.nominal, part.data)
    for own in missed(found.model, part.data, nominal, part.vectors, part is found.heldout):
        numbers: dict[str, Any] = {f"nominal_{unit}": off for unit, off in own.before.items()}
        if "px" in own.before:
            numbers["at_px"] = tuple(part.data.readings[own.row][:2].tolist())
        yield Residual(**own.entry, **own.after, **numbers)
