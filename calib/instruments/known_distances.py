"""Points a known way apart: sockets of a scale bar, or markers. They read no pose and give scale."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownDistance:
    """between : names of two sockets or of two markers; length, sigma : float, m."""

    between: tuple[str, str]
    length: float
    sigma: float
