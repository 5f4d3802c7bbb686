"""Numbers of a cell that look like another unit's."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.instruments import Instrument

_FINEST, _COARSEST = 1e-7, 5e-3  # m: no instrument of this trade reads better, or worse
_UNSTATED = 1.0  # m, of an instrument of which nothing is said
_NEAREST, _FARTHEST = 2e-3, 20.0  # m: between these lie the markers on a tool


def odd_noise(instrument: Instrument, finest: float = _FINEST) -> str:
    """What is odd about a standard deviation, below ``finest`` [m] or too large; empty for nothing."""
    sigma = instrument.even
    lengths = instrument.numbers[0].unit == "mm"
    if sigma is None or not lengths or sigma == _UNSTATED or finest <= sigma <= _COARSEST:
        return ""
    meant, factor = ("micrometres", 1.0) if sigma > _COARSEST else ("metres", 1e6)
    return (
        f"a standard deviation of {sigma * 1e3:.4g} mm is that of no instrument: if these are "
        f"{meant}, write {sigma * factor:.4g} mm (Python takes metres)"
    )


def odd_markers(markers: Array) -> str:
    """What is odd about markers (M, 3), m, in their tip's frame; empty where nothing is."""
    away = float(np.linalg.norm(markers, axis=1).max(initial=0.0))
    if 0.0 < away < _NEAREST and len(markers) > 1:
        remedy = "if these are metres, write millimetres"
    elif away > _FARTHEST:
        remedy = "if these are millimetres in Python, write metres"
    else:
        return ""
    return f"the farthest is {away * 1e3:.3g} mm from its link's origin: {remedy}"
