"""How near a tuned parameter must come to count as found: cycles of a ripple, moment of a step."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.withheld.causes import Cause
from studies.withheld.real.causes import fitted_clock
from studies.withheld.scene import Scene

LINES = 2.0
"""Widths of a spectral line within which the cycles of a ripple count as found."""
READINGS = 3.0
"""Readings within which the moment of a step counts as found."""


def tuning_of(scene: Scene, cause: Cause) -> dict[str, Any]:
    """Entries of a key: the tolerance of the tuned parameter, and what the data leave open of it.

    A line is 2 pi / range of the joint wide, in cycles a turn; between two readings a step may have
    been at any moment.
    """
    fitted = ~scene.session.held
    if cause.effect == "gear_ripple":
        q = scene.session.q[fitted, scene.arm.names.index(cause.where)]
        line = 2.0 * np.pi / float(np.ptp(q))
        tuned = {"name": "cycles", "values": _lines(cause), "tolerance": LINES * line}
        return {"tuned": {**tuned, "unit": "1/turn"}}
    if cause.effect == "step":
        at, own = cause.values["at"], fitted_clock(scene)
        gap = (float(own[own < at].max()), float(own[own >= at].min()))
        pace = float(own[-1]) / (scene.count - 1 if "time" in scene.columns else len(own) - 1)
        shown = "s" if "time" in scene.columns else "readings"
        tuned = {"name": "at", "values": [at], "tolerance": READINGS * pace}
        return {"tuned": {**tuned, "unit": shown}, "between": {"at": gap}}
    return {}


def _lines(cause: Cause) -> list[float]:
    """Cycles of the fundamental, and of its second harmonic where the cause has one."""
    cycles = cause.values["cycles"]
    return [k * cycles for k in (1, 2) if f"cos_{k}" in cause.values]
