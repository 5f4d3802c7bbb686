"""The figures of a diagnosis, from the fields of its result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from calib.arrays import Array
from studies.plots.error_curve import Panel, error_curve
from studies.plots.spectra import Mark, spectra
from studies.plots.spectra import Panel as Spectrum
from studies.plots.style import Picture
from studies.plots.waterfall import waterfall

_MM = 1e3


def pictures(fields: Mapping[str, Any]) -> Iterator[Picture]:
    """How the error falls, the error of each place over what it depends on, and what repeats."""
    steps = fields["steps"]
    rms, floor = np.array(steps["rms_mm"]) / _MM, fields["gap"]["floor_mm"] / _MM
    yield waterfall(steps["added"], rms, floor, of=steps["of"])
    for curve in fields["curves"]:
        arrays = {name: _array(curve[name]) for name in ("grid", "variable")}
        panels = [_panel(panel) for panel in curve["panels"]]
        yield error_curve(**{**curve, **arrays, "panels": panels})
    if fields.get("spectra"):
        yield spectra([_spectrum(entry) for entry in fields["spectra"]])


def _spectrum(entry: Mapping[str, Any]) -> Spectrum:
    return Spectrum(
        joint=entry["joint"],
        cycles=_array(entry["cycles_1_turn"]),
        fall=_array(entry["fall"]),
        false_alarm=entry["false_alarm"],
        width=entry["width_1_turn"],
        repeats=entry["repeats_1_turn"],
        marks=tuple(
            Mark(
                cycles=line["cycles"],
                std=line["std"],
                amplitude=line["amplitude_urad"],
                fall=line["fall"],
                ratios=tuple(line["ratios"]),
                aliases=tuple(line["aliases"]),
            )
            for line in entry["lines"]
        ),
    )


def _panel(fields: Mapping[str, Any]) -> Panel:
    kept = ("label", "line")
    given: dict[str, Any] = {
        name: value if name in kept or value is None else _array(value)
        for name, value in fields.items()
    }
    return Panel(**given)


def _array(values: Any) -> Array:
    """Numbers of a JSON file, where null stands for what is undefined."""
    return np.asarray(values, dtype=np.float64)
