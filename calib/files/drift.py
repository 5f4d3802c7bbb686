"""What the repeated readings say, in micrometres, microradians and hours."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.drift import Drift, Motion, Rate, Series

_UM = 1e6
_HOUR = 3600.0


def drift_fields(drift: Drift | None) -> dict[str, Any] | None:
    """The field ``drift`` of ``identify --json``; None where nothing was read again."""
    if drift is None:
        return None
    return {
        "verdict": drift.verdict,
        "p_value": drift.p,
        "degrees_of_freedom": drift.dof,
        "trend_p": _known(drift.trend_p),
        "noise_factor": drift.noise_factor,
        "one_side": drift.one_side,
        "rates": [{"station": station, **_rate(rate)} for station, rate in drift.rates.items()],
        "references": [_series(one) for one in drift.series],
    }


def _series(series: Series) -> dict[str, Any]:
    motions = [_motion(motion) for motion in series.motions()]
    return {
        "pose": series.names[0],
        "readings": len(series.names),
        "moved": motions,
        "last": motions[-1]["pose"] if motions else None,
        "largest": max(motions, key=lambda m: m["length_um"])["pose"] if motions else None,
    }


def _motion(motion: Motion) -> dict[str, Any]:
    return {
        "pose": motion.pose,
        "hours": _known(motion.time / _HOUR),
        "translation_um": list(motion.shift * _UM),
        "translation_std_um": list(motion.shift_std * _UM),
        "rotation_urad": list(motion.turn * _UM) if motion.rank > 3 else None,
        "rotation_std_urad": list(motion.turn_std * _UM) if motion.rank > 3 else None,
        "length_um": motion.length * _UM,
        "markers": motion.markers,
        "rank": motion.rank,
        "p_value": motion.p,
    }


def _rate(rate: Rate) -> dict[str, Any]:
    per_hour = _UM * _HOUR
    return {
        "translation_um_per_h": list(rate.shift * per_hour),
        "translation_std_um_per_h": list(rate.shift_std * per_hour),
        "rotation_urad_per_h": list(rate.turn * per_hour),
        "rotation_std_urad_per_h": list(rate.turn_std * per_hour),
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
