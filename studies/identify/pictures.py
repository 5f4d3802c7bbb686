"""The figures of an identification."""

from __future__ import annotations

import numpy as np

from calib import Identification
from studies.plots import ellipses, residuals
from studies.plots.style import Picture


def pictures(result: Identification) -> list[Picture]:
    """Residuals of the fitted poses, of those held out, and the correlation of the parameters."""
    names = result.model.marker_names
    found = []
    for part, name, title in (
        (result.fit, "residuals", "Residuals by pose"),
        (result.heldout, "residuals_heldout", "Residuals by pose, held out"),
    ):
        if part is not None:
            found.append(
                residuals.by_pose_and_axis(
                    part.data.poses.names,
                    part.vectors,
                    part.data.seen,
                    names,
                    result.noise.sigma,
                    part.outlier,
                    name=name,
                    title=title,
                )
            )
    known = result.std > 0.0
    matrix = np.where(known[:, None] & known, result.correlation, np.nan)
    found.append(ellipses.correlation([p.id for p in result.model.parameters], matrix))
    return found
