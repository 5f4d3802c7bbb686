"""The day as it will have been: the readings in hand, followed by those of the plan still to come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.statics import wrench_with_load
from calib.arrays import Array, IntArray, TextArray
from calib.cell import Cell
from calib.poses import Measurements, Poses
from calib.poses.moves import begins, in_order, moves
from doe.prospect.view import readings_of


def whole_day(cell: Cell, data: Measurements, plan: Poses, left: IntArray) -> Measurements:
    """Data and the readings ``left`` of a plan as one set; points still to come are zero.

    What is to come goes on at the pace, the temperature and the station of the data, in the order of
    the plan, with the markers that will be in sight.
    """
    if not len(left):
        return data
    coming = readings_of(cell, plan).take(left)
    poses = _followed(cell, data.poses, coming.poses)
    return Measurements(
        poses,
        np.concatenate([data.readings, coming.readings]),
        np.concatenate([data.seen, coming.seen]),
        np.concatenate([data.sigma, coming.sigma]),
    )


def _followed(cell: Cell, now: Poses, coming: Poses) -> Poses:
    order, k = in_order(now), len(coming)
    last = int(order[-1])
    way = np.concatenate([now.q[order], coming.q])
    fresh = np.concatenate([begins(now)[order], np.zeros(k, dtype=bool)])
    approach, motion = (part[len(now) :] for part in moves(way, fresh))
    ahead = np.arange(1.0, k + 1.0)
    return replace(
        now,
        names=(*now.names, *coming.names),
        q=np.concatenate([now.q, coming.q]),
        wrench=np.concatenate(
            [wrench_with_load(cell.robot, cell.gravity, p) for p in (now, coming)]
        ),
        temperature=_continued(now.temperature, last, np.zeros(k)),
        time=_continued(now.time, last, _pace(now.time) * ahead),
        order=_continued(now.order, last, ahead),
        torque=None,  # what the arm will measure nobody knows beforehand
        approach=None if now.approach is None else np.concatenate([now.approach, approach]),
        motion=None if now.motion is None else np.concatenate([now.motion, motion]),
        station=np.concatenate([now.station, np.full(k, now.station[last])]),
        load_mass=np.zeros(len(way)),
        site=None if now.site is None else np.concatenate([now.site, _sites(coming)]),
        session=None
        if now.session is None
        else np.concatenate([now.session, np.full(k, now.session[last])]),
    )


def _sites(coming: Poses) -> TextArray:
    return np.full(len(coming), "") if coming.site is None else coming.site


def _continued(values: Array | None, last: int, beyond: Array) -> Array | None:
    return None if values is None else np.concatenate([values, values[last] + beyond])


def _pace(time: Array | None) -> float:
    """Median time between two readings, s."""
    return 0.0 if time is None or len(time) < 2 else float(np.median(np.diff(np.sort(time))))
