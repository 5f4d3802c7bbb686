"""Points and joints, each from its own file, as the rows of ``measurements.csv``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from calib.arm.se3 import inverse, nearest_rotation, so3_log, transform
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.joints import JointRow, JointTable
from calib.files.exports.matching import BY_FILE, Exports, Matching
from calib.files.exports.points import MeasuredPoint, PointList, body_frame, body_texts
from calib.files.exports.sheet import NUMBER


def averaged(points: Sequence[MeasuredPoint]) -> tuple[list[MeasuredPoint], list[str]]:
    """The mean of the frames of every body at every pose, and what is said of their scatter."""
    groups: dict[tuple[str, str], list[MeasuredPoint]] = {}
    for own in points:
        groups.setdefault((own.pose, own.marker), []).append(own)
    counts = [len(group) for group in groups.values()]
    if max(counts) == 1:
        return list(points), []
    found, apart = [], []
    for group in groups.values():
        frames = np.array([body_frame(own.values) for own in group])
        R = nearest_rotation(frames[:, :3, :3].mean(axis=0))
        mean = transform(R, frames[:, :3, 3].mean(axis=0))
        off = inverse(mean) @ frames
        found.append(replace(group[0], values=body_texts(mean)))
        apart.append([_rms(off[:, :3, 3]), _rms(so3_log(off[:, :3, :3]))])
    mm, mrad = 1e3 * np.array(apart).T
    worst = found[
        int(np.argmax(mm / mm.max() + mrad / mrad.max() if mm.max() * mrad.max() else mm))
    ]
    most = f"{mm.max():.2g} mm, {mrad.max():.2g} mrad at most, as at pose {worst.pose[:40]}"
    few = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{max(counts)}"
    typical = f"{np.median(mm):.2g} mm and {np.median(mrad):.2g} mrad (RMS, median of the poses)"
    return found, [f"{few} frames of a pose are averaged; they scatter by {typical}; {most}"]


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


_SHOWN = 5  # names in one line


@dataclass(frozen=True)
class Joined:
    """The table that came of it, and what did not find its counterpart.

    columns, rows : of measurements.csv, as text
    pattern, tried : how names were read, as in Matching
    markers : points of each
    without_points : poses of the joint file
    without_joints : poses of the points, with the points of each that were left out
    strays : points whose names tell no pose and no known marker
    """

    columns: tuple[str, ...]
    rows: list[list[str]]
    pattern: str
    tried: dict[str, int]
    poses: tuple[str, ...]
    markers: dict[str, int]
    without_points: tuple[str, ...]
    without_joints: dict[str, int]
    strays: tuple[str, ...]
    notes: tuple[str, ...]


def join(
    lists: Sequence[PointList],
    joints: JointTable,
    *,
    names: str | None = None,
    marker: str | None = None,
    by_order: bool = False,
    partial: bool = False,
    markers: Sequence[str] | None = None,
    instrument: str | None = None,
) -> Joined:
    """Join lists of readings with the joint values of their poses, in the order of the joint file.

    names : pattern of :mod:`calib.files.exports.matching`; None tries the usual ones; of
        recordings the file's name is the pose where there are several or the joint file knows it, else
        the frame's number
    marker : the only marker, where names tell only the pose
    by_order : the k-th pose of the lists stands in the k-th row of the joint file
    partial : leave out what has no counterpart instead of refusing it
    markers : the ones that the cell knows
    instrument : that read all of them, as the cell calls it

    Raises InputError where names do not fit, a pose has a marker twice, or counterparts are missing.
    """
    if not by_order and not joints.named:
        remedy = "add a column pose, or give --by-order"
        raise InputError(joints.path, "header", "names no poses", remedy)
    first = lists[0]
    if len({own.written for own in lists}) > 1:
        what = f"holds {lists[-1].written[0]} .., {first.path} holds {first.written[0]} .."
        raise InputError(lists[-1].path, "", what, "import each kind for itself")
    if names is None and first.names:
        named = len(lists) > 1 or first.path.stem in {row.pose for row in joints.rows}
        names = BY_FILE[0] if first.frames and named else first.names
    exports = Exports(lists, joints, marker, by_order, markers)
    found = exports.matched(names)
    at = _rows_at(found, joints, by_order)
    poses = {own.pose for own in found.points}
    missing = tuple(name for name in at if name not in poses)
    orphans = Counter(own.pose for own in found.points if own.pose not in at)
    if not partial:
        _refuse(exports, found, missing, list(orphans))
    kept = [own for own in found.points if own.pose in at]
    if not kept:
        raise InputError(joints.path, "", "shares no pose with the points", "check --names")
    kept, said = averaged(kept) if first.frames else (kept, [])
    by_pose = _by_pose(kept)
    times, notes = _times(kept, joints)
    read_by = () if instrument is None else (instrument,)
    return Joined(
        (
            "pose",
            "marker",
            *("instrument",) * len(read_by),
            *joints.joints,
            *joints.carried,
            *first.written,
            *("time_s",) * bool(times),
            *("sigma_mm",) * _have_sigma(kept),
        ),
        [
            [pose, own.marker, *read_by, *row.values, *own.values]
            + [text for text in (times.get(pose, ""), own.sigma) if text]
            for pose, row in at.items()
            for own in by_pose.get(pose, {}).values()
        ],
        found.pattern,
        found.tried,
        tuple(name for name in at if name in poses),
        dict(Counter(own.marker for own in kept)),
        missing,
        dict(orphans),
        tuple(own.pose for own in found.strays),
        (*(note for own in lists for note in own.notes), *said, *notes),
    )


def _rows_at(found: Matching, joints: JointTable, by_order: bool) -> dict[str, JointRow]:
    if not by_order:
        return {row.pose: row for row in joints.rows}
    order = list(dict.fromkeys(own.pose for own in found.points))
    if len(order) != len(joints.rows):
        what = f"has {len(joints.rows)} rows where the points have {len(order)} poses"
        what += f" (names read as {found.pattern!r})"
        raise InputError(joints.path, "", what, "by order, each pose needs its row")
    return dict(zip(order, joints.rows, strict=True))


def _refuse(
    exports: Exports, found: Matching, missing: Sequence[str], orphans: Sequence[str]
) -> None:
    """Raise InputError for whatever has no counterpart."""
    read = f"(names read as {found.pattern!r})"
    remedy = "check --names and both files, or leave it out with --partial"
    if exports.lists[0].frames:
        remedy = (
            "name each recording as its pose, or its frames in the joint file; or give --partial"
        )
    if found.strays:
        own = found.strays[0]
        known = "" if exports.markers is None else f" of {', '.join(exports.markers)}"
        count = f", as {len(found.strays)} points in all" if len(found.strays) > 1 else ""
        what = f"{own.pose[:80]!r} names no pose and marker{known} {read}{count}"
        if own.marker:
            what = f"{own.marker[:80]!r} is nothing that the cell reads {read}{count}"
        raise own.fault(what, remedy)
    for names, what in ((missing, "of the joint file without points"), (orphans, "without joints")):
        if names:
            raise InputError(exports.joints.path, "", f"{some(names)} {what} {read}", remedy)


def some(names: Sequence[str]) -> str:
    """The first few of many poses."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    shown = ", ".join(name[:40] for name in names[:_SHOWN])
    return f"{len(names)} pose{'s' * (len(names) > 1)} ({shown}{more})"


def _by_pose(points: Sequence[MeasuredPoint]) -> dict[str, dict[str, MeasuredPoint]]:
    """Points by pose and marker. Raises InputError where a pose has a marker twice."""
    found: dict[str, dict[str, MeasuredPoint]] = {}
    for own in points:
        first = found.setdefault(own.pose, {}).setdefault(own.marker, own)
        if first is not own:
            place = "" if first.path == own.path else f" of {first.path}"
            where = f"in line {first.line}{place} already"
            what = f"pose {own.pose!r} has marker {own.marker!r} {where}"
            raise own.fault(what, "delete one, or name repeated readings as poses of their own")
    return found


def _have_sigma(points: Sequence[MeasuredPoint]) -> bool:
    """Whether points have uncertainties. Raises InputError where only some have."""
    bare = [own for own in points if not own.sigma]
    if bare and len(bare) < len(points):
        what = "has no uncertainties where another list has them"
        raise InputError(bare[0].path, "", what, "export all lists alike")
    return not bare


def _times(points: Sequence[MeasuredPoint], joints: JointTable) -> tuple[dict[str, str], list[str]]:
    """Time of each pose in seconds, that of its first point, and what is said about it."""
    if not all(own.time for own in points):
        some_timed = any(own.time for own in points)
        return {}, ["times left out: not every point has one"] * some_timed
    if "time_s" in joints.carried:
        return {}, ["time_s is that of the joint file, not that of the points"]
    first: dict[str, str] = {}
    for own in points:
        first.setdefault(own.pose, own.time)
    if all(NUMBER.fullmatch(text) for text in first.values()):
        return first, []
    try:
        stamps = {pose: datetime.fromisoformat(text) for pose, text in first.items()}
        start = min(stamps.values())
    except (ValueError, TypeError):
        shown = points[0].time[:40]
        return {}, [f"times such as {shown!r} left out: neither seconds nor ISO 8601"]
    seconds = {pose: (stamp - start).total_seconds() for pose, stamp in stamps.items()}
    return {pose: f"{value:.15g}" for pose, value in seconds.items()}, []
