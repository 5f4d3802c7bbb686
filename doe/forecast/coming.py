"""The readings to come: those of a plan that are left."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.api import Plan, in_turn, poses_of, readings, turn_of
from calib.arm.statics import wrench_with_load
from calib.arrays import IntArray
from calib.cell import Cell
from calib.poses import Measurements, Poses
from calib.poses.moves import alike, begins, in_order, moves, visits, with_moves
from doe.constraints import scene_of, visible

_AS_TOLD = np.radians(0.01)  # rad: robots go where they are told, and plans are rounded to this
_AS_TOLD_M = 1e-5
_AS_NAMED = np.radians(5.0)  # rad: a pose that was moved a little for want of room
_AS_NAMED_M = 0.05


def whole_day(
    cell: Cell, data: Measurements, plan: Poses, left: IntArray | None = None
) -> tuple[Measurements, IntArray]:
    """Data and the readings ``left`` of a plan as one set, and of each the pose of the plan, else -1.

    left : ndarray of int, of ``calib.readings(cell, plan)``, all without it
    Points still to come are zero. What is to come goes on at the pace of the data unless the plan has
    times, at the temperature and station of the data, in the order of the plan and from the sides that
    it prescribes, with the markers that will be in sight.
    """
    pose = np.full(len(data), -1)
    if not len(plan) or (left is not None and not len(left)):
        return data, pose
    turn = turn_of(cell, plan)
    kept = np.full(len(turn), True) if left is None else np.isin(turn, left)
    coming = readings_of(cell, plan).take(kept)
    now = replace(data.poses, torque=None)  # what the arm will measure nobody knows beforehand
    coming = replace(coming, poses=_following(now, coming.poses))
    day = replace(data, poses=now).then(coming)
    both = (wrench_with_load(cell.robot, cell.gravity, p) for p in (data.poses, coming.poses))
    wrench = np.concatenate(list(both))
    poses = replace(day.poses, wrench=wrench, load_mass=np.zeros(len(day)))
    return replace(day, poses=poses), np.concatenate([pose, turn[kept] % len(plan)])


def _following(now: Poses, coming: Poses) -> Poses:
    """Poses of a plan as they will be read after others: like the last of these, but for the plan."""
    order, ahead = in_order(now), np.arange(1.0, len(coming) + 1.0)
    last = now.take(np.full(len(coming), order[-1]))
    fresh = np.append(begins(now)[order], np.zeros(len(coming), dtype=bool))
    both = moves(np.concatenate([now.q[order], coming.q]), fresh)
    approach, motion = (part[len(now) :] for part in both)
    # The pace of the data, zero where nothing tells it.
    steps = np.diff(np.sort(np.zeros(0) if now.time is None else now.time))
    pace = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    later = pace * ahead if coming.time is None else pace + coming.time - coming.time[0]
    prescribed = coming.approach is not None and not coming.approach_derived
    return replace(
        coming,
        temperature=last.temperature,
        lagged=last.lagged,
        time=None if last.time is None else last.time + later,
        order=None if last.order is None else last.order + ahead,
        approach=coming.approach if prescribed else approach,
        motion=motion,
        station=last.station,
        site=np.full(len(coming), "") if coming.site is None else coming.site,
        session=last.session,
    )


def readings_of(cell: Cell, plan: Plan) -> Measurements:
    """The readings that a plan brings, their points still unknown."""
    if isinstance(plan, Measurements):
        return plan
    poses = poses_of(cell, plan)
    if poses.approach is None:
        poses = replace(with_moves(poses), order=None)  # a plan says nothing of when it is measured
    poses = in_turn(cell, poses)
    seen = visible(scene_of(cell, poses.q))
    blank = np.zeros((*seen.shape, cell.channels.width))
    return Measurements(poses, blank, seen, np.full(seen.shape, np.nan))


@dataclass(frozen=True, eq=False)
class Match:
    """The readings of a plan against those of the data.

    left : ndarray of int, readings of ``calib.readings(cell, plan)`` that are still to come
    poses : int, poses of the plan of which nothing is left
    begun : int, poses of the plan of which a reading is there and another is left
    warnings : tuple of str
    """

    left: IntArray
    poses: int
    begun: int
    warnings: tuple[str, ...]


def match(cell: Cell, plan: Poses, data: Poses) -> Match:
    """Find the readings of a plan in the data: by joints, or by name where the joints are near.

    However often a pose was read before the arm went on, it counts once, unless the readings carry
    different names of the plan. So a reference is to come as often as it was not yet measured.
    """
    wanted, count = readings(cell, plan), len(plan)
    if not count:
        return Match(np.zeros(0, dtype=int), 0, 0, ())
    plain = np.array(plan.names * (len(wanted) // count), dtype=object)
    named = np.array([(plain == n) | (np.array(wanted.names) == n) for n in data.names])
    off = np.abs(wanted.q - data.q[:, None])
    there = np.all(off <= np.where(cell.robot.prismatic, _AS_TOLD_M, _AS_TOLD), axis=-1)
    near = np.all(off <= np.where(cell.robot.prismatic, _AS_NAMED_M, _AS_NAMED), axis=-1)
    # Free or loaded, not to the newton.
    given, hung = (wrench_with_load(cell.robot, cell.gravity, p)[:, :3] for p in (data, wanted))
    least = 0.5 * np.maximum.outer(*(np.linalg.norm(force, axis=1) for force in (given, hung)))
    fits = np.linalg.norm(given[:, None] - hung, axis=-1) <= least
    # The first reading of each stay and load, and all that are known by name.
    _, first = np.unique(np.column_stack([visits(data), alike(data)]), axis=0, return_index=True)
    counted = [*first, *np.setdiff1d(np.flatnonzero(np.any(named, axis=1)), first)]
    left, warnings = np.ones(len(wanted), dtype=bool), []
    for one in counted:
        score = (left & fits[one]) * (2 * there[one] + (named[one] & near[one]))
        best = int(score.argmax())
        if score[best] > 0:
            left[best] = False
        if score[best] == 1:
            warnings.append(f"{data.names[one]} was measured beside the plan's joints: it counts")
        elif (left & fits[one] & named[one] & ~near[one]).any() and not score[best]:
            warnings.append(
                f"{data.names[one]} stands in the plan at quite other joints: is it the right plan?"
            )
    done = ~left.reshape(-1, count)
    whole = int(done.all(axis=0).sum())
    begun = int(done.any(axis=0).sum()) - whole
    return Match(np.flatnonzero(left), whole, begun, tuple(warnings))
