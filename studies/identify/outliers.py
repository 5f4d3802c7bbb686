"""The poses that stand out, and what they have in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from studies.record import Count, Entry, Maybe, Number

if TYPE_CHECKING:
    from calib.identification import Residuals
    from calib.identification.common import Shared

_MM = 1e3


class Outlier(Entry):
    """A pose that stands out."""

    pose: str
    reason: str


class Share(Entry):
    """What the outliers have in common, in the unit that it names."""

    variable: str
    low: Number
    high: Number
    unit: str
    poses: Count
    of_poses: Count
    outliers: Count
    of_outliers: Count
    p: Number
    beyond_all_others: Maybe


def outlier_entries(part: Residuals, footprint: float) -> Iterator[Outlier]:
    """The entries of the outliers among the poses fitted or held out."""
    for i in np.flatnonzero(part.outlier):
        errors = np.where(part.channels.lengths, part.vectors[i], 0.0)
        largest = float(np.linalg.norm(errors, axis=-1).max()) * footprint * _MM
        allowed = ", and the other poses leave nothing"
        if part.limit > 0.0:
            ratio = float(np.sqrt(part.statistic[i] / part.limit))
            allowed = f", {ratio:.1f} times what the other poses allow"
        name = part.data.poses.names[i]
        yield Outlier(pose=name, reason=f"residual up to {largest:.3f} mm{allowed}")


def share_entry(common: Shared | None) -> Share | None:
    """The entry of what outliers share; None where they share nothing."""
    if common is None:
        return None
    return Share(
        variable=common.variable,
        low=common.low / common.scale,
        high=common.high / common.scale,
        unit=common.unit,
        poses=common.inside,
        of_poses=common.poses,
        outliers=common.outliers,
        of_outliers=common.of,
        p=common.p,
        beyond_all_others=common.alone / common.scale if common.alone else None,
    )
