"""The errors that the nominal and the identified model leave, as entries of the record."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
from pydantic import computed_field, model_validator

from studies.document import MRAD, Shown
from studies.fitted import Angles, Lengths, Pixels, ResidualEntry, residual_fields
from studies.record import Count, Entry, Maybe, NotNegative, Three

if TYPE_CHECKING:
    from calib import Identification
    from calib.arrays import Array
    from calib.identification import Residuals

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
