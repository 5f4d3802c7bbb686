"""The figures of an identification, and the errors of the measured points that they draw."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import ellipses, residuals
from studies.plots.errors import by_pose, histogram
from studies.plots.residuals import over_image
from studies.plots.style import Picture

if TYPE_CHECKING:
    from studies.identify.record import IdentifyRecord

K = TypeVar("K")
HELD_OUT = " (held out)"
"""After the name of a held-out pose that is called as a fitted one."""

_MM = 1e3


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Measured minus predicted points of m poses and M markers.

    poses, markers : tuple of str, names in the order of the rows
    before, after : ndarray, shape (m, M, 3), m, by the nominal model and as found; zero where hidden
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
        return replace(
            self,
            poses=tuple(name for name, own in zip(self.poses, chosen, strict=True) if own),
            **{
                name: getattr(self, name)[chosen] for name in ("before", "after", "seen", "heldout")
            },
        )

    def by_pose(self, errors: Array) -> Array:
        """RMS over the markers of each pose, shape (m,), of ``before`` or ``after``."""
        squared = np.where(self.seen, (errors**2).sum(axis=-1), np.nan)
        return np.asarray(np.sqrt(np.nanmean(squared, axis=1)))


def point_errors(record: IdentifyRecord) -> PointErrors:
    """Arrays from the residuals of a record that are lengths."""
    rows = [row for row in record.residuals if row.metric]
    # Two tables of a session may call their poses alike.
    poses = _places((row.pose, row.heldout) for row in rows)
    read = {(row.pose, row.heldout, row.marker) for row in rows}
    alone = len(read) == len(rows)  # several instruments may read one marker at a pose
    what = [row.marker if alone else f"{row.instrument}: {row.marker}" for row in rows]
    markers = _places(what)
    shape = len(poses), len(markers), 3
    before, after = np.zeros(shape), np.zeros(shape)
    seen = np.zeros(shape[:2], dtype=bool)
    at = [poses[row.pose, row.heldout] for row in rows], [markers[name] for name in what]
    before[at] = np.array([_in_space(row.before) for row in rows]).reshape(-1, 3) / _MM
    after[at] = np.array([_in_space(row.vector) for row in rows]).reshape(-1, 3) / _MM
    seen[at] = True
    names = tuple(name + HELD_OUT * (held and (name, False) in poses) for name, held in poses)
    heldout = np.array([held for _, held in poses], dtype=bool)
    return PointErrors(names, tuple(markers), before, after, seen, heldout)


def _in_space(error: Sequence[float]) -> tuple[float, ...]:
    """Three numbers; one length by itself takes the place of the first."""
    return (*error, *[0.0] * (3 - len(error)))


def _places(keys: Iterable[K]) -> dict[K, int]:
    """The place of each key, in the order in which they come first."""
    return {key: i for i, key in enumerate(dict.fromkeys(keys))}


def distances(record: IdentifyRecord) -> Picture:
    """Distances before and after as a histogram."""
    fitted = _part(record, heldout=False)
    sigma = record.noise.instrument_mm / _MM
    return histogram(fitted.before[fitted.seen], fitted.after[fitted.seen], sigma)


def errors_by_pose(record: IdentifyRecord) -> Picture:
    """How far each pose was off and is now."""
    found, sigma = point_errors(record), record.noise.instrument_mm / _MM
    before, after = (found.by_pose(own) for own in (found.before, found.after))
    return by_pose(found.poses, before, after, found.heldout, sigma)


def residuals_by_pose(record: IdentifyRecord, heldout: bool) -> Picture:
    """Residuals by pose and axis, of the poses fitted or held out."""
    own = _part(record, heldout)
    out = {entry.pose for entry in (record.heldout_outliers if heldout else record.outliers)}
    where = "held-out" if heldout else "fitted"
    return residuals.by_pose_and_axis(
        own.poses, own.after, own.seen, own.markers, record.noise.instrument_mm / _MM,
        np.array([pose.removesuffix(HELD_OUT) in out for pose in own.poses]),
        name=f"residuals{'_heldout' * heldout}", title=f"Residuals at the {where} poses",
    )  # fmt: skip


def errors_over_image(record: IdentifyRecord) -> Picture:
    """What cameras measured beyond what is predicted, over their images."""
    fields = {}
    seen = [row for row in record.residuals if row.at_px is not None]
    for camera in dict.fromkeys(row.instrument for row in seen):
        own = [row for row in seen if row.instrument == camera]
        at, off = np.array([row.at_px for row in own]), np.array([row.vector for row in own])
        fields[camera] = at, off, tuple(f"{row.pose} {row.marker}" for row in own)
    return over_image(fields)


def correlation(record: IdentifyRecord) -> Picture:
    """Correlation of the parameters that were estimated."""
    known = np.array([p.std is not None for p in record.parameters])
    matrix = np.array(record.correlation, dtype=np.float64)
    matrix = np.where(known[:, None] & known, matrix, np.nan)
    return ellipses.correlation([p.id for p in record.parameters], matrix)


def _part(record: IdentifyRecord, heldout: bool) -> PointErrors:
    errors = point_errors(record)
    return errors.take(errors.heldout == heldout)
