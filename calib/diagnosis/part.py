"""The part of a large table that is diagnosed; the rest tells how well that went.

Every suspect is looked at in every number that was read, so memory and time grow with the table and
have no end. What is found of a part is fitted to that part, and is held against configurations outside
of it as against any that were held out. A part of n of N numbers shows errors ``sqrt(N / n)`` times as
large as the whole would.
"""

from __future__ import annotations

import numpy as np

from calib.poses import Measurements
from calib.poses.moves import spread, thinned_words

_NUMBERS = 12_000  # that are looked at: two gigabytes
_LEAST = 200  # readings, however many numbers each has


def part_of(data: Measurements) -> tuple[Measurements, Measurements, tuple[str, ...]]:
    """What is diagnosed, the readings at other configurations, and what a user should know of it.

    All, none and nothing where the table is not large.
    """
    numbers = data.seen.sum() * data.readings.shape[-1] / max(len(data), 1)
    kept = spread(data, max(_LEAST, int(_NUMBERS / max(numbers, 1.0))))
    if kept.all():
        return data, data.take(~kept), ()
    configuration = data.poses.configuration
    rest = data.take(~np.isin(configuration, configuration[kept]))
    larger = np.sqrt(len(data) / kept.sum())
    said = f"{thinned_words(data, kept)}; all of them would show errors {larger:.1f} times smaller"
    if len(rest):
        said += f"; {len(rest)} at other configurations were held out"
    return data.take(kept), rest, (said,)
