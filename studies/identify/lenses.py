"""The lenses of cameras, as they were found: entries, and how they are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies import document as doc
from studies.document import MRAD, Shown, mm
from studies.record import Entry, From, MaybePositive, NotNegative, Number

if TYPE_CHECKING:
    from calib import Identification

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
