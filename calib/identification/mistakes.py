"""Which mistake would explain data that no arm could have given: each is undone and looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.errors import ImplausibleData
from calib.identification.misplaced import (
    exchanged,
    placed,
    shifted,
    some,
    telling,
)
from calib.identification.slips import Slip, slips, taken_as_known, two_zeros
from calib.identification.start import missed_by, refuse_unreachable
from calib.model import Model
from calib.poses import Measurements

_FAR = 0.015
"""Of the arm's reach: no pose of a healthy day is missed by as much. The worst real pose at hand, of an
IRB 120, is missed by 1.2 %."""
_ARM = 0.01  # of the arm's reach: what a mended day may err by
_SHARE = 0.1  # of the spread of the points: what hardly moves is missed by little whatever is done
_TIMES = 10.0  # by which the misfit must fall
_ALIKE = 3.0  # times the least misfit: the data do not tell
_POSES = 40  # they tell as much as a thousand, in a hundredth of the time
_MOST = 0.8  # of the poses must fit once it is mended
_CLOSEST = 8  # looked at again, without gross errors
_UNREACHED = 100.0  # arm lengths between points, beyond which a unit is wrong
_SHOWN = 6


@dataclass(frozen=True)
class Mistake:
    """What would explain the data; several names where these explain it as well.

    names, said, remedies : tuple of str, one each
    nominal, mended : float, m, RMS by which the nominal arm misses the points, as read and mended
    poses : tuple of str, where only these are concerned
    """

    names: tuple[str, ...]
    said: tuple[str, ...]
    remedies: tuple[str, ...]
    nominal: float
    mended: float
    poses: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """One line: what is wrong, how that is known, what to do."""
        fits = "the nominal arm fits there" if self.poses else "the nominal arm fits"
        return (
            f"{', or '.join(self.said)}: once corrected, {fits} to {_in_mm(self.mended)} instead of "
            f"{_in_mm(self.nominal)}; {'; or '.join(self.remedies)}"
        )


def _in_mm(length: float) -> str:
    return f"{length * 1e3:.0f} mm" if length >= 0.01 else f"{length * 1e3:.2g} mm"


def refuse_mistakes(model: Model, data: Measurements, start: Array) -> None:
    """Refuse data that a known mistake explains and no arm.

    start : ndarray, shape (p,), SI, base and markers under the nominal arm

    Raises ImplausibleData, CalibError for points that no arm of this size could have reached.
    """
    tracked = model.tracked(data)
    if tracked is None:  # what people get wrong is known of points only
        return
    model, data = tracked
    missed = missed_by(model, data, start)
    found = recognised(model, data, missed)
    if found is not None:
        raise ImplausibleData(found.text, found.names, found.nominal, found.mended, found.poses)
    refuse_unreachable(model, data, _UNREACHED)


def recognised(model: Model, data: Measurements, missed: Array) -> Mistake | None:
    """The mistake that explains the data, None where they are plausible or none explains them.

    missed : ndarray, shape (m,), m, RMS by which the nominal arm misses the markers of each pose
    """
    far = _FAR * model.robot.reach
    if not (missed > far).any():
        return None
    counts = np.bincount(data.poses.station[data.seen.any(axis=1)])
    here = data.take((data.poses.station == counts.argmax()) & data.seen.any(axis=1))
    sample = some(here, _POSES)
    if not telling(sample):
        return None
    nominal = placed(model, sample)
    found = None
    if nominal.missed.max() > far:
        tables = (slips(model), *((slip,) for slip in taken_as_known(model)))
        tried = (_undone(model, sample, nominal.missed, table) for table in tables)
        found = next(filter(None, tried), None)
    found = found or _shifted(model, here) or _renamed(model, data, far)
    if found is None and nominal.missed.max() > far:
        found = _undone(model, sample, nominal.missed, two_zeros(model))
    return found


def _undone(
    model: Model, sample: Measurements, missed: Array, table: tuple[Slip, ...]
) -> Mistake | None:
    """The entries of a table that bring the arm to its points, gross errors aside."""
    tried = [(slip, slip.freed(model, sample), slip.undone(sample)) for slip in table]
    first = [placed(own, data, rounds=1).share for _, own, data in tried]
    closest = [i for i in np.argsort(first)[:_CLOSEST] if first[i] <= _ALIKE * min(first)]
    again = [(slip, placed(own, data)) for slip, own, data in (tried[i] for i in closest)]
    fitting = []
    for slip, fit in again:
        # The arm then errs as arms do, beside its motion as well, and did not before.
        least = min(_ARM * model.robot.reach, _rms(missed[fit.kept]) / _TIMES)
        if fit.rms <= least and fit.share <= _SHARE and fit.kept.mean() >= _MOST:
            fitting.append((slip, fit))
    if not fitting:
        return None
    best = min((fit for _, fit in fitting), key=lambda fit: fit.share)
    alike = [slip for slip, fit in fitting if fit.share <= _ALIKE * best.share]
    return Mistake(
        tuple(slip.name for slip in alike),
        tuple(slip.said for slip in alike),
        tuple(slip.remedy for slip in alike),
        _rms(missed[best.kept]),
        best.rms,
    )


def _shifted(model: Model, data: Measurements) -> Mistake | None:
    """Points one pose beside their joints, from the first pose to the last or from a lost one on."""
    found = shifted(model, data, _ARM * model.robot.reach, _SHARE)
    if found is None or _rms(found.before) < _TIMES * _rms(found.after):
        return None
    names = tuple(data.poses.names[i] for i in found.run)
    where = "" if found.whole else f" from {names[0]} to {names[-1]}"
    beside, down = ("next pose", "down") if found.by > 0 else ("pose before", "up")
    return Mistake(
        (f"shifted by {found.by}",),
        (f"the points are shifted by one pose against the joints{where}: they fit the {beside}",),
        (f"move their columns {down} by one pose",),
        _rms(found.before),
        _rms(found.after),
        () if found.whole else names,
    )


def _renamed(model: Model, data: Measurements, far: float) -> Mistake | None:
    """Two markers exchanged at some poses: far off as they read, near with the exchange undone."""
    order, before, after = exchanged(model, data)
    limit = np.minimum(_ARM * model.robot.reach, before / _TIMES)
    wrong = np.flatnonzero((before > far) & (after <= limit))
    if not len(wrong):
        return None
    poses = tuple(data.poses.names[i] for i in wrong)
    moved = order[wrong] != np.arange(data.seen.shape[1])
    said = []
    for pair in np.unique(moved, axis=0):
        one, other = (model.marker_names[j] for j in np.flatnonzero(pair))
        at = [name for name, own in zip(poses, moved, strict=True) if np.array_equal(own, pair)]
        shown = ", ".join(at[:_SHOWN]) + (f" .. ({len(at)} in all)" if at[_SHOWN:] else "")
        said.append(f"markers {one} and {other} are exchanged at {shown}")
    return Mistake(
        ("exchanged",),
        ("; ".join(said),),
        ("exchange their names there",),
        _rms(before[wrong]),
        _rms(after[wrong]),
        poses,
    )


def _rms(lengths: Array) -> float:
    return float(np.sqrt(np.mean(lengths**2)))
