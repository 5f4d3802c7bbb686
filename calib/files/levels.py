"""The levels of noise in millimetres and microradians, as seen at the tip."""

from __future__ import annotations

from typing import Any

from calib.cell import Repeatability
from calib.scatter import Levels, Scatter

_MM, _URAD = 1e3, 1e6


def level_fields(levels: Levels | None, scatter: Scatter | None) -> dict[str, Any]:
    """Fields of ``noise``: deviations of one coordinate of the tip, null where the data cannot tell.

    ``repeatability`` is new at each approach, ``configuration`` differs from pose to pose and comes
    again at the same joints. Without poses that were approached again, and without a figure in the
    cell, configuration holds both.
    """
    if levels is None or scatter is None:
        return {
            **_fields("repeatability", None),
            **_fields("configuration", None),
            "instrument_seen": False,
        }
    v = levels.variances
    known = levels.approaches or bool(v.approach.any())
    repeats = scatter.of_tip(v.approach) if known else None
    return {
        **_fields("repeatability", repeats),
        **_fields("configuration", scatter.of_tip(v.configuration)),
        "instrument_seen": levels.instrument_seen,
    }


def _fields(name: str, found: Repeatability | None) -> dict[str, float | None]:
    return {
        f"{name}_mm": None if found is None else found.translation * _MM,
        f"{name}_urad": None if found is None else found.rotation * _URAD,
    }
