"""The figures of an identification, from the fields of its result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from studies.identify.point_errors import point_errors
from studies.plots import ellipses, residuals
from studies.plots.histogram import histogram
from studies.plots.style import Picture
from studies.plots.workspace import workspace

_MM = 1e3


def pictures(fields: Mapping[str, Any]) -> Iterator[Picture]:
    """Errors before and after, by pose, expected over the workspace; correlation of the parameters."""
    yield from residual_pictures(fields)
    yield from workspace_pictures(fields)
    known = np.array([p["std"] is not None for p in fields["parameters"]])
    matrix = np.where(known[:, None] & known, np.array(fields["correlation"]), np.nan)
    yield ellipses.correlation([p["id"] for p in fields["parameters"]], matrix)


def residual_pictures(fields: Mapping[str, Any]) -> Iterator[Picture]:
    """Distances before and after as a histogram; residuals by pose and axis, fitted and held out."""
    errors = point_errors(fields["residuals"], "nominal_mm")
    sigma = instrument_sigma(fields["noise"])
    fitted = errors.take(~errors.heldout)
    yield histogram(fitted.before[fitted.seen], fitted.after[fitted.seen], sigma)
    for part, key, name, title in (
        (fitted, "outliers", "residuals", "Residuals by pose"),
        (errors.take(errors.heldout), "heldout_outliers", "residuals_heldout",
         "Residuals by pose, held out"),
    ):  # fmt: skip
        if part.poses:
            out = {entry["pose"] for entry in fields[key]}
            yield residuals.by_pose_and_axis(
                part.poses, part.after, part.seen, part.markers, sigma,
                np.array([pose in out for pose in part.poses]), name=name, title=title,
            )  # fmt: skip


def instrument_sigma(noise: Mapping[str, Any]) -> float:
    """Noise of one coordinate [m] that residuals are held against.

    That of repeated readings where they tell it, else the instrument's as stated: what the residuals
    themselves say would make any of them look right.
    """
    key = "believed_sigma_mm" if noise["source"] == "residual" else "sigma_mm"
    return float(noise[key]) / _MM


def workspace_pictures(fields: Mapping[str, Any]) -> Iterator[Picture]:
    """The error that the parameters' uncertainty leaves, where the tip is at the targets."""
    rows = fields["at_targets"]
    tips = np.array([[row[f"tip_{axis}_mm"] for axis in "xyz"] for row in rows], dtype=float)
    yield workspace(tips / _MM, np.array([row["expected_mm"] for row in rows], dtype=float) / _MM)
