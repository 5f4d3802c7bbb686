"""Speeds and accelerations of a run: every channel through the same filter, forwards and backwards.

Standstill before the first motion and after the last one is left out: brakes hold there, and what the
sensors say is no torque of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.motion.motions import Run

CUTOFF = 8.0  # Hz; held-out errors hardly change between 4 and 20
SLOW = 0.02  # rad/s or m/s: below it a joint stands
_OF_RATE = 0.2  # of the sampling rate, above which no cutoff lies
_ORDER = 4
_ENDS = 0.5  # periods of the cutoff at both ends, where a filter has no past or future


@dataclass(frozen=True, eq=False)
class Samples:
    """A run at equal steps of time, filtered; rows m, joints n.

    q, v, a : ndarray, shape (m, n), rad or m, and per second
    effort, slope : ndarray, shape (m, n), N m, N or A, and a second
    beyond : ndarray, shape (m, n), value behind the gear less that before it, or None
    noise : ndarray, shape (n,), deviation of white noise of the effort that passes the filter
    sos : the filter
    """

    name: str
    time: Array
    q: Array
    v: Array
    a: Array
    effort: Array
    slope: Array
    noise: Array
    sos: Array
    beyond: Array | None = None

    def __len__(self) -> int:
        return len(self.time)

    def smoothed(self, columns: Array) -> Array:
        """Columns (m, k) through the filter of all channels."""
        from scipy.signal import sosfiltfilt

        return np.asarray(sosfiltfilt(self.sos, columns, axis=0, padlen=min(30, len(columns) - 1)))


def filtered(run: Run, cutoff: float = CUTOFF) -> Samples:
    """A run through a Butterworth filter of fourth order without a phase.

    cutoff : Hz, at most a fifth of the sampling rate
    """
    from scipy.interpolate import CubicSpline, make_interp_spline
    from scipy.signal import butter, sosfiltfilt

    step = run.step
    cutoff = min(cutoff, _OF_RATE / step)
    time = np.arange(run.time[0], run.time[-1], step)
    sos = butter(_ORDER, cutoff * step * 2.0, output="sos")

    def smooth(channel: Array) -> Array:
        even = CubicSpline(run.time, channel)(time)
        return np.asarray(sosfiltfilt(sos, even, axis=0))

    q, effort = smooth(run.q), smooth(run.effort)
    curve, torque = make_interp_spline(time, q, 5), CubicSpline(time, effort)
    rough = np.diff(CubicSpline(run.time, run.effort)(time) - effort, axis=0)
    # Of white noise the filter passes cutoff over half the rate; what it stops is mostly such noise.
    white = np.median(np.abs(rough), axis=0) / 0.6745 / np.sqrt(2.0)
    noise = white * np.sqrt(2.0 * cutoff * step)
    beyond = None if run.link is None else smooth(run.link - run.q)
    v = curve(time, 1)
    kept = _in_motion(v, min(int(_ENDS / cutoff / step), len(time) // 4))
    return Samples(
        run.name,
        time[kept],
        q[kept],
        v[kept],
        curve(time, 2)[kept],
        effort[kept],
        torque(time, 1)[kept],
        noise,
        sos,
        None if beyond is None else beyond[kept],
    )


def _in_motion(v: Array, ends: int) -> slice:
    """From the first to the last sample (m,) at which a joint moves, without the ends of the filter."""
    moving = np.flatnonzero((np.abs(v) > SLOW).any(axis=1))
    if not len(moving):
        return slice(0, 0)
    return slice(max(int(moving[0]), ends), min(int(moving[-1]) + 1, len(v) - ends))
