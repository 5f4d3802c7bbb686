"""Spectra of the residual in the units of the file formats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.arrays import Array
from calib.diagnosis.spectra import Line, Spectrum

_MOST = 800  # numbers of cycles in a file: several at each pixel of a figure
_URAD = 1e-6


def spectra_fields(spectra: Sequence[Spectrum]) -> list[dict[str, Any]]:
    """The entries ``spectra`` of ``diagnose --json``, thinned so that every peak stays."""
    return [_spectrum(spectrum) for spectrum in spectra]


def with_aliases(effects: Sequence[dict[str, Any]], spectra: Sequence[Spectrum]) -> None:
    """Give entries of gear ripples the cycles that these poses cannot tell from theirs, if any."""
    known = {spectrum.joint: spectrum for spectrum in spectra}
    for effect in effects:
        if effect["effect"] != "gear_ripple" or effect["where"] not in known:
            continue
        (cycles,) = (p["value"] for p in effect["parameters"] if p["name"] == "cycles")
        spectrum = known[effect["where"]]
        for own, aliases in spectrum.named:
            if aliases and abs(own - cycles) < 0.01 * spectrum.width:
                effect["aliases"] = _rounded(aliases)


def _spectrum(spectrum: Spectrum) -> dict[str, Any]:
    cycles, fall = _thinned(spectrum.cycles, spectrum.fall)
    return {
        "joint": spectrum.joint,
        "cycles_1_turn": _rounded(cycles),
        "fall": _rounded(fall),
        "false_alarm": spectrum.false_alarm,
        "width_1_turn": spectrum.width,
        "repeats_1_turn": spectrum.repeats,
        "lines": [_line(line) for line in spectrum.lines],
    }


def _line(line: Line) -> dict[str, Any]:
    return {
        "cycles": line.cycles,
        "std": line.std,
        "amplitude_urad": line.amplitude / _URAD,
        "amplitude_std_urad": line.amplitude_std / _URAD,
        "fall": line.fall,
        "ratios": list(line.ratios),
        "aliases": _rounded(line.aliases),
    }


def _thinned(cycles: Array, fall: Array) -> tuple[Array, Array]:
    """The highest of every few that follow each other."""
    step = -(-len(cycles) // _MOST)
    starts = range(0, len(cycles), step)
    kept = [i + int(np.argmax(fall[i : i + step])) for i in starts]
    return cycles[kept], fall[kept]


def _rounded(values: Sequence[float] | Array) -> list[float]:
    return [round(float(value), 2) for value in values]
