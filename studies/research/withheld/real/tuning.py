"""How near a tuned parameter must come to count as found: cycles of a ripple, moment of a step."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.research.withheld.causes import Cause
from studies.research.withheld.real.causes import fitted_clock
from studies.research.withheld.scene import Scene

LINES = 2.0
"""Widths of a spectral line within which the cycles of a ripple count as found."""
READINGS = 3.0
"""Readings within which the moment of a step counts as found."""


def tuning_of(scene: Scene, cause: Cause) -> dict[str, Any]:
    """Entries of a key: the tolerance of the tuned parameter, and what the data leave open of it.

    A line is 2 pi / range of the joint wide, in cycles a turn; between two readings a step may have
    been at any moment.
    """
    own = fitted_clock(scene)
    if cause.effect == "gear_ripple":
        q = scene.session.q[~scene.session.held, scene.arm.names.index(cause.where)]
        line = 2.0 * np.pi / float(np.ptp(q))
        return {"tuned": _near(cause, "cycles", "1/turn", LINES * line)}
    if cause.effect == "step":
        at, pace = cause.values["at"], float(own[-1]) / (len(own) - 1)
        gap = (float(own[own < at].max()), float(own[own >= at].min()))
        shown = "s" if "time" in scene.columns else "readings"
        return {"tuned": _near(cause, "at", shown, READINGS * pace), "between": {"at": gap}}
    return {}


def _near(cause: Cause, name: str, shown: str, tolerance: float) -> dict[str, Any]:
    return {"name": name, "value": cause.values[name], "unit": shown, "tolerance": tolerance}
