"""The identified parameters, and what the readings leave open."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies import document as doc
from studies.document import Shown
from studies.record import (
    OWN_UNIT,
    Entry,
    From,
    Maybe,
    MaybePositive,
    Number,
    Positive,
)

if TYPE_CHECKING:
    from calib import Identification
    from calib.arrays import Array, Mask
    from calib.inference.widths import Widths
    from calib.instruments import Camera


_PLACED = ("base", "tool")


class IdentifiedParameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    """

    id: str
    name: Annotated[str, Shown("parameter")]
    effect: str
    where: str
    value: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, OWN_UNIT]
    ci95: Annotated[tuple[Number, Number] | None, OWN_UNIT]
    degrees_of_freedom: Maybe
    unit: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in _PLACED


class RedundantParameter(Entry):
    """A constant that others stand for at any pose."""

    id: Annotated[str, Shown("constant error")]
    absorbed_by: tuple[str, ...]


class SizeOfErrors(Entry):
    """Standard deviation, between such errors, of those of one effect that have one unit."""

    effect: Annotated[str, From("0")]
    width: Annotated[Positive, OWN_UNIT]
    unit: Annotated[str, From("1")]


class SizePrior(Entry):
    """What holds the values that the readings leave open.

    parameters : how many of them it determines in place of the readings
    """

    parameters: Annotated[Positive, From("saved")]
    widths: tuple[SizeOfErrors, ...]


def parameter_entries(found: Identification) -> tuple[IdentifiedParameter, ...]:
    """The entries of all parameters, in the order of the model."""
    known = (found.std > 0.0) & np.isfinite(found.std)
    return IdentifiedParameter.from_each(
        found.model.parameters,
        value=found.values,
        std=np.where(known, found.std, np.nan),
        ci95=[own if k else None for own, k in zip(found.interval().tolist(), known, strict=True)],
        degrees_of_freedom=np.where(known, found.freedoms, np.nan),
    )


def sizes_entry(found: Widths) -> SizePrior:
    """The entry of the widths that an identification found."""
    of = found.of
    widths = SizeOfErrors.from_each(of.classes, width=found.widths, scale=of.scales)
    return SizePrior.from_result(found, widths=widths)


_IN_PIXELS = 4


class LensValue(Entry):
    """A value of a camera's lens: as the cell gives it, and as it was found.

    std : None where it was not estimated
    """

    camera: str
    name: Annotated[str, Shown("value")]
    nominal: Number
    value: Number
    std: MaybePositive
    unit: str


def lens_entries(found: Identification) -> Iterator[LensValue]:
    """All values of the lenses of which anything was found."""
    from calib.instruments import Camera

    for camera in found.model.readout.channels.instruments:
        if not isinstance(camera, Camera):
            continue
        values, covariance, asked = _lens_of(found, camera)
        std = np.sqrt(np.diag(covariance))
        if asked.any():
            yield from LensValue.from_each(
                [{"camera": camera.name}] * len(std),
                name=camera.lens.names,
                nominal=camera.lens.values,
                value=values,
                std=np.where(std > 0.0, std, np.nan),
                unit=["px" if i < _IN_PIXELS else "1" for i in range(len(std))],
            )


def _lens_of(result: Identification, camera: Camera) -> tuple[Array, Array, Mask]:
    """Values (n,) of a camera's lens, their covariance (n, n), and which were asked for, (n,).

    In the order and the units of :class:`calib.instruments.lens.Lens`.
    """
    from calib.effects.base import Base
    from calib.effects.lens import LensEffect

    by = np.zeros((len(camera.lens.values), len(result.values)))
    for effect, part in result.model.parts:
        if isinstance(effect, Base) and effect.of.name == camera.name:
            by[camera.free, np.arange(part.stop - len(camera.free), part.stop)] = 1.0
        elif isinstance(effect, LensEffect) and effect.changes(camera):
            by[effect.values, part] = np.eye(part.stop - part.start)
    covariance = by @ result.covariance @ by.T
    return camera.lens.values + by @ result.values, covariance, np.asarray(by.any(axis=1))


_LENSES = doc.columns(
    LensValue,
    "camera name",
    doc.Column("cell", lambda row: (row.nominal, row.std), doc.TO_STD),
    doc.Column("found", lambda row: (row.value, row.std), doc.TO_STD),
    doc.Column("standard\ndeviation", lambda row: row.std and (row.std, row.std), doc.TO_STD),
    "unit",
)


def told_lenses(lenses: tuple[LensValue, ...]) -> Iterator[doc.Part]:
    """The values."""
    yield doc.Table(_LENSES, list(lenses))
