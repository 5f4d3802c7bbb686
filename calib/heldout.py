"""Which poses take no part in a fit: a table of their own, or a share of the configurations."""

from __future__ import annotations

import numpy as np

from calib.errors import CalibError
from calib.poses import Measurements


def parted(
    data: Measurements,
    heldout: Measurements | float | None,
    rng: np.random.Generator | int = 0,
) -> tuple[Measurements, Measurements | None]:
    """What is fitted, and what is not.

    heldout : measurements, a share of the configurations between 0 and 1, or None
    rng : a generator, or the seed of one, that draws the share

    Raises CalibError where the share is none, or leaves nothing to fit.
    """
    if heldout is None or isinstance(heldout, Measurements):
        return data, heldout
    if isinstance(heldout, bool) or not isinstance(heldout, int | float):
        what = f"heldout is a {type(heldout).__name__}"
        raise CalibError(f"{what}; give measurements, or a share between 0 and 1")
    if not 0.0 < heldout < 1.0:
        raise CalibError(f"heldout {heldout} is not between 0 and 1; give a share such as 0.3")
    return data.split(float(heldout), np.random.default_rng(rng))
