"""Where the base, the bodies and the markers are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from studies.record import Entry, Three, three

if TYPE_CHECKING:
    from calib import Identification
    from calib.arrays import Array

_MM = 1e3


class Placement(Entry):
    """The base in the frame of the readings."""

    rotation_vector_rad: Three
    translation_mm: Three


class Base(Placement):
    """Placement at the first station, and at each where there are several."""

    stations: dict[str, Placement] = Field(default_factory=dict)


def base_entry(found: Identification) -> Base:
    """The entry of the base, at each station."""
    stations = {where: _placement(placed) for where, placed in found.bases.items()}
    first = next(iter(stations.values()), _placement(np.zeros(6)))
    return Base(**first.model_dump(), stations=stations if len(stations) > 1 else {})


def body_entries(found: Identification) -> dict[str, Placement]:
    """Each body's frame in the tip's."""
    from calib.instruments import Pose

    return {
        found.model.marker_names[first]: _placement(np.concatenate(body))
        for i in found.model.instruments
        if isinstance(i, Pose)
        for first, body in i.bodies(found.marker_positions)
    }


def marker_entries(found: Identification) -> dict[str, tuple[float, float, float]]:
    """Those that are read by their names."""
    model = found.model
    read: list[int] = np.unique(model.readout.channels.marker).tolist()
    return {model.marker_names[j]: three(found.marker_positions[j] * _MM) for j in read}


def _placement(placed: Array) -> Placement:
    from calib.arm.se3 import so3_exp, so3_log

    return Placement(
        rotation_vector_rad=three(so3_log(so3_exp(placed[3:]))),
        translation_mm=three(placed[:3] * _MM),
    )
