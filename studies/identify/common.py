"""What outliers have in common, in one sentence of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def shared_sentence(share: Mapping[str, Any]) -> str:
    """The field ``outliers_share`` of ``identify --json``, in words."""
    name = str(share["variable"]).removeprefix("q:")
    low, high, unit = f"{share['low']:.4g}", f"{share['high']:.4g}", share["unit"]
    if share["beyond_all_others"] is not None:
        return (
            f"An outlier is the only pose at {name} = {high} {unit}, {share['beyond_all_others']:.3g} "
            f"{unit} beyond every other: the model is extrapolated there, and may be at fault."
        )
    span = f"{low} to {high}" if low != high else low
    return (
        f"Outliers with something in common are a signal, not a fault: {share['outliers']} of "
        f"{share['of_outliers']} have {name} in {span} {unit}, where {share['poses']} of "
        f"{share['of_poses']} poses are (by chance {share['p']:.1g}). Believe the figures over all "
        "poses, and look for what the model lacks there."
    )
