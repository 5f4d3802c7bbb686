"""What may have come up that no parameter of the model can express: by what the fits leave.

A fit leaves ``left^2 n / f`` a degree of freedom, n poses and f of them not spent on parameters: what
is outside the model errs with the pose, so poses are counted and not points. All that is known of what
came up is by how much more the later fit leaves than the earlier one.
"""

from __future__ import annotations

import numpy as np

from calib.change.known import Known
from calib.uncertainty.freedom import freedom

_LIMIT = 1.96  # standard deviations of the difference of two mean squares, 97.5 % from above


def outside(before: Known, after: Known) -> float | None:
    """Upper limit of it at other poses, RMS, 3-D per point, m; None where a day tells no poses."""
    if before.poses is None or after.poses is None:
        return None
    (then, few), (now, others) = _square(before), _square(after)
    doubt = np.sqrt(2.0 * then**2 / few + 2.0 * now**2 / others)
    return float(np.sqrt(max(now - then, 0.0) + _LIMIT * doubt))


def _square(known: Known) -> tuple[float, float]:
    """Mean square of what a fit leaves, m^2, and its degrees of freedom."""
    poses = 0 if known.poses is None else len(known.poses)
    free = freedom(np.inf, poses, len(known.values), as_a_whole=True)
    return known.left**2 * poses / free, free
