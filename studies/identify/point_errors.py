"""Errors of the measured points, read back from the fields of a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array

HELD_OUT = " (held out)"
"""After the name of a held-out pose that is called as a fitted one."""

_MM = 1e3
_MOST = 3_000_000  # points; a damaged file may name poses and markers that fill any memory


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Measured minus predicted points of m poses and M markers.

    poses, markers : tuple of str, names in the order of the rows
    before, after : ndarray, shape (m, M, 3), m, by the model as given and as found; zero where hidden
    seen : ndarray of bool, shape (m, M)
    heldout : ndarray of bool, shape (m,), poses that took no part in the fit
    """

    poses: tuple[str, ...]
    markers: tuple[str, ...]
    before: Array
    after: Array
    seen: NDArray[np.bool_]
    heldout: NDArray[np.bool_]

    def take(self, chosen: NDArray[np.bool_]) -> PointErrors:
        """The poses of a mask, shape (m,)."""
        return PointErrors(
            tuple(name for name, own in zip(self.poses, chosen, strict=True) if own),
            self.markers,
            self.before[chosen],
            self.after[chosen],
            self.seen[chosen],
            self.heldout[chosen],
        )


def point_errors(residuals: Sequence[Mapping[str, Any]], before: str) -> PointErrors:
    """Arrays from the rows ``residuals`` of a result.

    before : key of the errors before: "nominal_mm" of ``identify``, "before_mm" of ``diagnose``

    Raises ValueError for more points than any measurement has.
    """
    poses = {key: i for i, key in enumerate(dict.fromkeys(map(_pose, residuals)))}
    markers = {name: j for j, name in enumerate(dict.fromkeys(r["marker"] for r in residuals))}
    shape = len(poses), len(markers), 3
    if len(poses) * len(markers) > _MOST:
        raise ValueError(f"{len(poses)} poses with {len(markers)} markers are too many")
    first, second = np.zeros(shape), np.zeros(shape)
    seen = np.zeros(shape[:2], dtype=bool)
    for row in residuals:
        at = poses[_pose(row)], markers[row["marker"]]
        first[at] = np.asarray(row[before], dtype=float) / _MM
        second[at] = np.array([row["x_mm"], row["y_mm"], row["z_mm"]], dtype=float) / _MM
        seen[at] = True
    names = [name + HELD_OUT * (held and (name, False) in poses) for name, held in poses]
    heldout = np.array([held for _, held in poses], dtype=bool)
    return PointErrors(tuple(names), tuple(markers), first, second, seen, heldout)


def _pose(row: Mapping[str, Any]) -> tuple[str, bool]:
    """Name, and whether held out: two tables of a session may call their poses alike."""
    return row["pose"], bool(row["heldout"])
