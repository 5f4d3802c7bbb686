"""The errors that the nominal and the identified model leave: their entries, and how they are told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import computed_field, model_validator

from studies import document as doc
from studies.document import MRAD, Shown, mm
from studies.fitted import Angles, Lengths, Pixels, ResidualEntry, residual_fields
from studies.identify.outliers import told_outliers
from studies.identify.pictures import (
    distances,
    errors_by_pose,
    errors_over_image,
    point_errors,
    residuals_by_pose,
)
from studies.record import Count, Entry, Maybe, NotNegative, Three

if TYPE_CHECKING:
    from calib import Identification
    from calib.arrays import Array
    from calib.identification import Residuals
    from studies.identify.record import IdentifyRecord

_MM = 1e3


class ErrorFigures(Entry):
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
    nominal: Annotated[NotNegative | None, Shown(rule=MRAD)] = None
    fitted_all: Annotated[NotNegative | None, Shown("identified", MRAD)] = None
    fitted: NotNegative | None = None
    heldout: Annotated[NotNegative | None, Shown("held out", MRAD)] = None
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


class IdentifyResidual(ResidualEntry):
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


def distances_entry(found: Identification, figure: Callable[[Array], float]) -> ErrorFigures:
    """The entry of a figure; nothing where no reading is a length."""
    metric = found.fit.channels.metric
    known = {key: figure(d) * _MM for key, d in found.distances.items() if metric and len(d)}
    return ErrorFigures.model_validate({key: known.get(key) for key in ErrorFigures.model_fields})


def rms_of(distances: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(distances**2)))


def instrument_entries(found: Identification) -> tuple[OfInstrument, ...]:
    """The entries of each instrument's errors."""
    return tuple(
        OfInstrument.model_validate({"instrument": name, "unit": unit, **rms})
        for (name, unit), rms in found.by_instrument.items()
    )


def pair_entries(found: Identification) -> Iterator[tuple[Model, Pairs]]:
    """The entries of the errors between points of two poses, by model."""
    from calib.identification.residuals import pair_errors
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
            mm = np.abs(errors) * _MM
            p95, most = np.quantile(mm, (0.95, 1.0)).tolist()
            yield key, Pairs(rms=rms_of(mm), p95=p95, max=most, pairs=len(mm))


def residual_entries(found: Identification, part: Residuals) -> Iterator[IdentifyResidual]:
    """The entries of the readings fitted or held out."""
    nominal = found.model.off(found.nominal, part.data)
    heldout = part is found.heldout
    every = residual_fields(found.model, part.data, nominal, part.vectors, heldout, "nominal")
    yield from (IdentifyResidual(**fields) for fields in every)


_MODELS: dict[Model, str] = {
    "nominal": "fitted poses, nominal model",
    "fitted_all": "fitted poses, identified",
    "fitted": "fitted poses without outliers, identified",
    "heldout": "held-out poses, identified",
    "heldout_trimmed": "held-out poses without outliers, identified",
}
_FIGURES = ("RMS [mm]", "p95 [mm]", "max [mm]")
_ERRORS = doc.heads("distance measured - predicted", *_FIGURES)
_PAIRS = doc.heads("distance between two poses", *_FIGURES, Shown("pairs", doc.COUNT))
_OF_INSTRUMENTS = doc.columns(OfInstrument, "instrument unit nominal fitted_all heldout")


def told_errors(record: IdentifyRecord) -> Iterator[doc.Part]:
    """How far the readings were off and are now, by model, by instrument and pose by pose."""
    floor = mm(3.0**0.5 * record.noise.instrument_mm)
    caption = f"Distances in space; the instrument alone would leave {floor} RMS"
    if rows := list(_models(record)):
        yield doc.Table(_ERRORS, rows, "Errors by model", caption)
        yield doc.Figure(lambda: distances(record))
    if len(record.instruments) > 1 or not rows:
        caption = "Root mean squares; of whole poses, the length of the translation and of the turn"
        yield doc.Table(_OF_INSTRUMENTS, record.instruments, "Errors by instrument", caption)
    every = {**_MODELS, "fitted": _MODELS["fitted_all"]}
    pairs = [
        (every[key], own.rms, own.p95, own.max, own.pairs)
        for key, own in record.pair_distances_mm.items()
    ]
    caption = (
        "Distances between points of two poses, measured minus predicted: a check that depends on no "
        "frame, since distances are the same wherever the instrument stands"
    )
    yield doc.Detail(
        (doc.Table(_PAIRS, pairs, "Distances between two poses", caption),) if pairs else ()
    )
    yield from told_outliers(record)
    if any(row.at_px is not None for row in record.residuals):
        yield doc.Figure(lambda: errors_over_image(record))
    if not rows:
        return
    yield doc.Figure(lambda: errors_by_pose(record))
    yield doc.Figure(lambda: residuals_by_pose(record, heldout=False))
    if record.rms_mm.heldout is not None:
        yield doc.Figure(lambda: residuals_by_pose(record, heldout=True))
    yield doc.Detail(
        (doc.Table(_POSES, _by_pose(record), "Errors pose by pose", of_poses=True, fold=True),)
    )


def _models(record: IdentifyRecord) -> Iterator[tuple[Any, ...]]:
    trimmed = {"fitted": record.outliers, "heldout_trimmed": record.heldout_outliers}
    for key, label in _MODELS.items():
        if key == "heldout":
            yield from _nominal_at_heldout(record)
        row = [getattr(figures, key) for figures in (record.rms_mm, record.p95_mm, record.max_mm)]
        if row[0] is not None and trimmed.get(key, True):
            yield label, *row


def _nominal_at_heldout(record: IdentifyRecord) -> Iterator[tuple[Any, ...]]:
    """RMS, 95th percentile and largest distance, mm, where anything is held out."""
    rows = [row for row in record.residuals if row.heldout and row.metric]
    if rows:
        lengths = np.array([np.linalg.norm(row.before) for row in rows])
        p95, most = np.quantile(lengths, (0.95, 1.0)).tolist()
        yield "held-out poses, nominal model", rms_of(lengths), p95, most


_POSES = doc.heads(
    "pose", "RMS before [mm]", "RMS after [mm]", Shown("markers seen", doc.COUNT), "use"
)


def _by_pose(record: IdentifyRecord) -> list[tuple[Any, ...]]:
    found = point_errors(record)
    before, after = (1e3 * found.by_pose(errors) for errors in (found.before, found.after))
    use = ["held out" if held else "fitted" for held in found.heldout]
    seen = found.seen.sum(axis=1).tolist()
    return list(zip(found.poses, before, after, seen, use, strict=True))
