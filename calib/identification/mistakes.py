"""Which mistake would explain data that no arm could have given: each is undone and looked at.

The nominal arm is laid over some of the readings. Entries of
:mod:`calib.identification.data_mistakes` concern every reading. Two more concern a few: a run of poses
shifted by one against their joints, and markers that changed names at some poses; these stand out, and
come near once that is undone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask, stacked
from calib.effects.tool_base import Base
from calib.errors import ImplausibleData
from calib.identification.checks import refuse_unreachable
from calib.identification.data_mistakes import DataMistake, reordered, tables, two_zeros
from calib.identification.start import initial_values
from calib.instruments.placing import levers
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

# Of the arm's reach: no pose of a healthy day is missed by as much; the worst real one, by 1.2 %.
_FAR = 0.015
_ARM = 0.01  # of the arm's reach: what a mended day may err by
_SHARE = 0.1  # of the spread of the points: what hardly moves is missed by little whatever is done
_TIMES = 10.0  # by which the misfit must fall
_ALIKE = 3.0  # times the least misfit: the data do not tell
_POSES, _EXCHANGE_POSES = 40, 60  # they tell as much as a thousand, in a hundredth of the time
_MOST, _MOST_SHIFTED = 0.8, 0.9  # of the poses must fit once it is mended
_LOOSE = 3.0  # times as far may the arm miss its points where its base may stretch too
_CLOSEST = 8  # looked at again, without gross errors
_UNREACHED = 100.0  # arm lengths between points, beyond which a unit is wrong
_SHOWN = 6  # poses named
_GROSS, _ROUNDS = 10.0, 4  # times the median miss: a pose beyond it has an error of its own
_RIGID = np.array([0, 3, 5, 6])  # coordinates of a body that 0, 1, 2 or more markers fix
_DECISIVE = 24  # coordinates: twelve that base and tool take at most, and as many that must fit
_FEWEST = 5  # poses that only the shift explains: a few wrong readings are no shift
_TURNS = 12  # of fit and exchange


class Mistake(NamedTuple):
    """What would explain the data; several entries where these explain it as well.

    nominal, mended : float, m, RMS by which the nominal arm misses the points, as read and mended
    poses : tuple of str, where only these are concerned
    """

    entries: tuple[DataMistake, ...]
    nominal: float
    mended: float
    poses: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the entries."""
        return tuple(entry.name for entry in self.entries)

    @property
    def text(self) -> str:
        """One line: what is wrong, how that is known, what to do."""
        mended, nominal = (
            f"{length * 1e3:.0f} mm" if length >= 0.01 else f"{length * 1e3:.2g} mm"
            for length in (self.mended, self.nominal)
        )
        there = " there" if self.poses else ""
        said = ", or ".join(entry.said for entry in self.entries)
        remedies = "; or ".join(entry.remedy for entry in self.entries)
        return (
            f"{said}: once corrected, the nominal arm fits{there} to {mended} "
            f"instead of {nominal}; {remedies}"
        )


def refuse_mistakes(model: Model, data: Measurements, start: Array) -> None:
    """Refuse data that a known mistake explains and no arm.

    start : ndarray, shape (p,), SI, base and markers under the nominal arm

    Raises ImplausibleData, CalibError for points that no arm of this size could have reached.
    """
    if (tracked := model.tracked(data)) is None:  # what people get wrong is known of points only
        return
    model, data = tracked
    mistake = recognised(model, data, _missed(model, data, start))
    if mistake is not None:
        raise ImplausibleData(mistake.text, mistake.names, *mistake[1:])
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
    sample = _some(here, _POSES)
    if not _decisive(sample):
        return None
    missed = _placed(model, sample).missed
    everywhere = missed.max() > far
    every = (_undone(model, sample, missed, table) for table in tables(model) if everywhere)
    mistake = next((one for one in every if one), None)
    mistake = mistake or _shifted(model, here) or _exchanged(model, data, far)
    last = two_zeros(model) if everywhere else ()
    return mistake or _undone(model, sample, missed, last)


# -- the nominal arm over some readings ------------------------------------------------------------


class _Placed(NamedTuple):
    """Base and markers under the nominal arm.

    values : ndarray, shape (p,), SI; missed : ndarray, shape (m,), m, root mean square of each pose's
        markers; kept : ndarray of bool, shape (m,), all but gross errors
    rms : float, m, of the poses kept; share : float, of the spread of their points
    """

    values: Array
    missed: Array
    kept: Mask
    rms: float
    share: float

    def fits(self, least: float, most: float) -> bool:
        """Whether so many poses are missed by little, beside their motion as well."""
        return bool(self.rms <= least and self.share <= _SHARE and self.kept.mean() >= most)


def _placed(model: Model, data: Measurements, rounds: int = _ROUNDS) -> _Placed:
    """Fit base and markers, again without the poses that stand far out as long as those change."""
    kept = seen = np.asarray(data.seen.any(axis=1))
    for _ in range(rounds):
        values = initial_values(model, data.take(kept))
        missed = _missed(model, data, values)
        near = seen & (missed <= _GROSS * np.median(missed[kept]))
        if np.array_equal(near, kept):
            break
        kept = near
    rms, spread = (
        _rms(missed[kept]),
        float(np.sqrt(data.points[kept][data.seen[kept]].var(0).sum())),
    )
    return _Placed(values, missed, kept, rms, rms / spread if spread > 0.0 else np.inf)


def _affine(model: Model, data: Measurements) -> float:
    """RMS, m, of the poses that fit best, as many as must, where the base may stretch too.

    Without the constraint of a turn the problem is linear, and soon solved: what is not near then is
    never near. Zero where the base is known, as nothing has to be searched.
    """
    if not len(model.where(Base)):
        return 0.0
    frames, (pose, marker) = forward(model.robot, data.poses.q), np.nonzero(data.seen)
    tip = pose, model.marker_frames[marker]
    R, y = frames.R[tip], data.points[pose, marker]
    there = frames.o[tip] + rotate(R, model.markers[marker])
    of_base = np.einsum("nk,cd->ncdk", np.c_[y, np.ones(len(y))], np.eye(3)).reshape(len(y), 3, 12)
    A = np.concatenate([of_base, levers(marker, R, free_components(model))], axis=-1)
    count = data.seen.sum(axis=1)
    kept = np.ones(len(count), dtype=bool)
    for _ in range(_ROUNDS):
        rows = kept[pose]
        values = np.linalg.lstsq(stacked(A[rows]), there[rows].ravel(), rcond=None)[0]
        squares = ((there - A @ values) ** 2).sum(axis=-1)
        missed = np.sqrt(np.bincount(pose, squares, len(count)) / count)
        kept = missed <= np.quantile(missed, _MOST)
    return _rms(missed[kept])


def _missed(model: Model, data: Measurements, values: Array) -> Array:
    """How far the readings of each pose lie from where they are predicted, RMS, shape (m,), m."""
    off = model.off(values, data)
    return np.asarray(np.sqrt((off**2).sum(axis=(1, 2)) / np.maximum(data.seen.sum(axis=1), 1)))


def _some(data: Measurements, count: int) -> Measurements:
    """At most so many of the readings, one of each configuration."""
    _, first = np.unique(data.poses.configuration, return_index=True)
    chosen: IntArray = np.random.default_rng(0).permutation(first)[:count]
    return data.take(np.sort(chosen))


def _decisive(data: Measurements) -> bool:
    """Whether readings are so many that they do not fit a wrong idea by chance."""
    return bool(_RIGID[np.minimum(data.seen.sum(axis=1), 3)].sum() >= _DECISIVE)


def _rms(lengths: Array) -> float:
    return float(np.sqrt(np.mean(lengths**2)))


# -- every reading ---------------------------------------------------------------------------------


def _undone(
    model: Model, sample: Measurements, missed: Array, table: tuple[DataMistake, ...]
) -> Mistake | None:
    """The entries of a table that bring the arm to its points, gross errors aside."""
    near = _ARM * model.robot.reach
    undone = [(entry, *entry.undone(model, sample)) for entry in table]
    tried = [own for own in undone if _affine(*own[1:]) <= _LOOSE * near]
    first = [_placed(*own[1:], rounds=1).share for own in tried]
    closest = [i for i in np.argsort(first)[:_CLOSEST] if first[i] <= _ALIKE * min(first)]
    # The arm then errs as arms do, and did not before.
    fitting = []
    for i in closest:
        fit = _placed(*tried[i][1:])
        if fit.fits(min(near, _rms(missed[fit.kept]) / _TIMES), _MOST):
            fitting.append((tried[i][0], fit))
    if not fitting:
        return None
    best = min((fit for _, fit in fitting), key=lambda fit: fit.share)
    alike = tuple(entry for entry, fit in fitting if fit.share <= _ALIKE * best.share)
    return Mistake(alike, _rms(missed[best.kept]), best.rms)


# -- points beside their joints --------------------------------------------------------------------


def _shifted(model: Model, data: Measurements) -> Mistake | None:
    """Points one pose beside their joints, from the first pose to the last or from a lost one on."""
    order = data.poses.order
    if order is None:
        return None
    data, order = data.take(np.argsort(order)), np.sort(order)
    runs = [run for by in (1, -1) for run in _runs(model, data, order, by)]
    mistake = max(runs, key=lambda run: run[0], default=(0, None))[1]
    return mistake if mistake and mistake.nominal >= _TIMES * mistake.mended else None


def _runs(model: Model, data: Measurements, order: Array, by: int) -> Iterator[tuple[int, Mistake]]:
    """Runs of so many poses that fit only at the joints of the one that was measured ``by`` later."""
    near, beside = _ARM * model.robot.reach, np.arange(len(data)) + by
    there = (beside >= 0) & (beside < len(data))
    there[there] = order[beside[there]] - order[there] == by  # none between was held out
    rows = np.flatnonzero(there)
    moved = replace(data.take(rows), poses=data.poses.take(rows + by))
    pose, way = ("next pose", "down") if by > 0 else ("pose before", "up")
    for values in _placings(model, (moved, data), near):
        before, after = _missed(model, data, values), np.full(len(data), np.inf)
        after[rows] = _missed(model, moved, values)
        as_read, as_moved = before <= near, after <= near
        only = np.flatnonzero(as_moved & ~as_read)
        if len(only) < _FEWEST:
            continue
        run = np.arange(only[0], only[-1] + 1)
        held, outside = there[run], np.delete(as_read, run)
        fits = outside.mean() >= _MOST_SHIFTED if len(outside) > 2 else True
        if not fits or as_moved[run][held].mean() < _MOST_SHIFTED:
            continue
        run = run[held & as_moved[run]]
        some = bool((as_read & ~as_moved).any())  # poses fit as they are
        names = tuple(data.poses.names[i] for i in run) if some else ()
        where = f" from {names[0]} to {names[-1]}" if some else ""
        said = f"the points are shifted by one pose against the joints{where}: they fit the {pose}"
        entry = DataMistake(f"shifted by {by}", said, f"move their columns {way} by one pose")
        yield len(run), Mistake((entry,), _rms(before[run]), _rms(after[run]), names)


def _placings(model: Model, readings: tuple[Measurements, ...], near: float) -> Iterator[Array]:
    """Base and markers from what fits of each half, as read and moved: a run leaves one half alone."""
    for data in readings:
        middle = len(data) // 2
        for half in (slice(None, middle), slice(middle, None)):
            sample = _some(data.take(half), _POSES)
            if not _decisive(sample) or _affine(model, sample) > _LOOSE * near:
                continue
            if (fit := _placed(model, sample)).fits(near, _MOST_SHIFTED):
                yield fit.values


# -- markers under each other's names --------------------------------------------------------------


def _exchanged(model: Model, data: Measurements, far: float) -> Mistake | None:
    """Two markers exchanged at some poses: far off as they read, near with the exchange undone.

    Where half of the readings or more are exchanged, the others come out.
    """
    m, M = data.seen.shape
    order, before, after = np.tile(np.arange(M), (m, 1)), np.zeros(m), np.zeros(m)
    for station in range(len(data.poses.stations)):
        here = np.flatnonzero((data.poses.station == station) & (data.seen.sum(axis=1) >= 2))
        own = data.take(here)
        values = _settled(model, own)
        if values is not None:
            order[here] = _best_order(model, own, values)
            before[here] = _missed(model, own, values)
            after[here] = _missed(model, reordered(own, order[here]), values)
    limit = np.minimum(_ARM * model.robot.reach, before / _TIMES)
    wrong = np.flatnonzero((before > far) & (after <= limit))
    if not len(wrong):
        return None
    poses, moved = np.array(data.poses.names)[wrong], order[wrong] != np.arange(M)
    said = []
    for pair in np.unique(moved, axis=0):
        one, other = (model.marker_names[j] for j in np.flatnonzero(pair))
        at = poses[(moved == pair).all(axis=1)].tolist()
        shown = ", ".join(at[:_SHOWN]) + (f" .. ({len(at)} in all)" if at[_SHOWN:] else "")
        said.append(f"markers {one} and {other} are exchanged at {shown}")
    entry = DataMistake("exchanged", "; ".join(said), "exchange their names there")
    return Mistake((entry,), _rms(before[wrong]), _rms(after[wrong]), tuple(poses.tolist()))


def _settled(model: Model, data: Measurements) -> Array | None:
    """Base and markers once the exchanges are undone: fit and exchange take turns on some poses."""
    sample = _some(data, _EXCHANGE_POSES)
    if not _decisive(sample):
        return None
    values, last = _placed(model, sample).values, np.zeros(0, dtype=int)
    for _ in range(_TURNS):
        order = _best_order(model, sample, values)
        if np.array_equal(order, last):
            break
        values, last = _placed(model, reordered(sample, order)).values, order
    return values


def _best_order(model: Model, data: Measurements, values: Array) -> IntArray:
    """The exchange of one pair that brings each pose nearest to its prediction, shape (m, M)."""
    expected = model.predict(values, data.poses)
    m, M = data.seen.shape
    apart = ((data.points[:, :, None] - expected[:, None]) ** 2).sum(axis=-1)
    a, b = np.array(list(itertools.combinations(range(M), 2))).T
    gain = apart[:, a, a] + apart[:, b, b] - apart[:, a, b] - apart[:, b, a]
    gain = np.where(data.seen[:, a] & data.seen[:, b], gain, 0.0)
    best, rows = gain.argmax(axis=1), np.arange(m)
    better = gain[rows, best] > 0.0
    order = np.tile(np.arange(M), (m, 1))
    rows, a, b = rows[better], a[best[better]], b[best[better]]
    order[rows, a], order[rows, b] = b, a
    return order
