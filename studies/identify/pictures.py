"""The figures of an identification."""

from __future__ import annotations

import numpy as np

from studies.identify.point_errors import HELD_OUT, PointErrors, point_errors
from studies.identify.record import IdentifyRecord
from studies.plots import ellipses, residuals
from studies.plots.by_pose import by_pose
from studies.plots.histogram import histogram
from studies.plots.image import over_image
from studies.plots.style import Picture

_MM = 1e3


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
