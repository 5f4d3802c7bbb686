"""The identified parameters, and what the readings leave open."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies import document as doc
from studies.document import MRAD, Shown, mm
from studies.record import (
    OWN_UNIT,
    Entry,
    From,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
)

if TYPE_CHECKING:
    from calib import Identification
    from calib.population.sizes import Widths


_PLACED = ("base", "tool")


class IdentifiedParameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    std_by_pose : if the points of a pose err together, as under a model that lacks something
    step_two_optimism : factor by which it would be less if base and tool were known
    """

    id: str
    name: Annotated[str, Shown("parameter")]
    effect: str
    where: str
    value: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, OWN_UNIT]
    ci95: Annotated[tuple[Number, Number] | None, OWN_UNIT]
    degrees_of_freedom: Maybe
    std_by_pose: Annotated[Maybe, OWN_UNIT]
    step_two_optimism: Maybe
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
    nothing = np.full(len(found.values), np.nan)
    return IdentifiedParameter.from_each(
        found.model.parameters,
        value=found.values,
        std=np.where(known, found.std, np.nan),
        ci95=[own if k else None for own, k in zip(found.interval().tolist(), known, strict=True)],
        degrees_of_freedom=np.where(known, found.freedoms, np.nan),
        std_by_pose=nothing if found.std_by_pose is None else found.std_by_pose,
        step_two_optimism=found.optimism,
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


class UnfitLensEntry(Entry):
    """A camera whose readings do not fit the lens that the cell gives; free : what to free of it."""

    camera: str
    free: tuple[str, ...]
    rms_px: Annotated[NotNegative, From("left_px")]
    with_it_free_px: Annotated[NotNegative, From("freed_px")]
    pixel_mm: Annotated[MaybePositive, From("pixel_m")]

    @property
    def said(self) -> str:
        """What is wrong, how much, and what to do."""
        at = ""
        if self.pixel_mm is not None:
            at = f" ({mm(self.rms_px * self.pixel_mm)} at the board)"
        free = ", ".join(f'"{part}"' for part in self.free)
        return (
            f"The readings do not fit the lens of {self.camera}: {MRAD(self.rms_px)} px remain{at}, "
            f"{MRAD(self.with_it_free_px)} px with another lens. Set `free = [{free}]` there."
        )


def lens_entries(found: Identification) -> Iterator[LensValue]:
    """All values of the lenses of which anything was found."""
    from calib.identification.lenses import lens_of
    from calib.instruments import Camera

    for camera in found.model.readout.channels.instruments:
        if not isinstance(camera, Camera):
            continue
        values, covariance, asked = lens_of(found, camera)
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


_LENSES = doc.columns(
    LensValue,
    "camera name",
    doc.Column("cell", lambda row: (row.nominal, row.std), doc.TO_STD),
    doc.Column("found", lambda row: (row.value, row.std), doc.TO_STD),
    doc.Column("standard\ndeviation", lambda row: row.std and (row.std, row.std), doc.TO_STD),
    "unit",
)


def told_lenses(lenses: tuple[LensValue, ...]) -> Iterator[doc.Part]:
    """The values, and how they get into a file."""
    yield doc.Table(_LENSES, list(lenses))
    cameras = list(dict.fromkeys(own.camera for own in lenses))
    options = " ".join(
        f"--calibration {f'{name}=' if len(cameras) > 1 else ''}{name}.yaml" for name in cameras
    )
    them = "the lens" if len(cameras) == 1 else "the lenses"
    yield doc.Sentence(f"`{options}` writes {them} as OpenCV reads it; name it .ros.yaml for ROS")
