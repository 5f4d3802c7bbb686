"""Images of boards, of folders or recordings, as readings of the cameras that took them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import Cell
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports import Joined, JointTable, PointList
from calib.files.exports.bags import Recording
from calib.files.exports.images import Pattern, pattern_of
from calib.files.exports.join import join
from calib.files.exports.sightings import (
    IMAGES,
    Shot,
    Sighting,
    file_shots,
    look,
    point_list,
)
from calib.instruments import Camera


@dataclass(frozen=True, eq=False)
class Batch:
    """Images of one camera and the joint values of their poses; path : where they come from."""

    camera: str
    path: Path
    shots: list[Shot]
    joints: JointTable


@dataclass(frozen=True, eq=False)
class Images:
    """What came of images: lists of points and the table that they make with the joints.

    seen : what each image shows, by camera
    """

    lists: list[PointList]
    joints: JointTable
    joined: Joined
    seen: dict[str, list[Sighting]]


def image_files(paths: Iterable[Path]) -> list[Path]:
    """Images as given, and all of a folder in the order of their names. Raises InputError."""
    found: list[Path] = []
    for path in paths:
        own = [path]
        if path.is_dir():
            own = sorted(file for file in path.iterdir() if file.suffix.lower() in IMAGES)
            if not own:
                raise InputError(path, "", "holds no images", f"give {', '.join(IMAGES)}")
        found += own
    return found


def patterns_of(cell: Cell, boards: Sequence[str]) -> list[Pattern]:
    """The boards to look for. Raises InputError."""
    return [pattern_of(cell.path, name) for name in boards]


def cameras_of(cell: Cell) -> dict[str, Camera]:
    """The cell's cameras by name. Raises InputError where it has none."""
    found = {own.name: own for own in cell.instruments if isinstance(own, Camera)}
    if not found:
        raise InputError(cell.path, "instruments", "has no camera", 'add one of kind = "camera"')
    return found


def file_batches(
    paths: Sequence[Path], joints: JointTable, cell: Cell, camera: str | None, by_order: bool
) -> list[Batch]:
    """Image files by the camera that took them: the one named, the only one, or the folder's name.

    by_order : the k-th image of a camera stands in the k-th row of the joint file

    Raises InputError.
    """
    cameras = cameras_of(cell)
    if camera is None and len(cameras) > 1:
        strange = next((path for path in paths if path.name not in cameras), None)
        if strange is not None:
            what = f"is of one of the cameras {', '.join(cameras)}"
            remedy = "give --instrument NAME, or a folder of images for each, named as the camera"
            raise InputError(strange, "", what, remedy)
        own = {path.name: image_files([path]) for path in paths}
    else:
        own = {camera or next(iter(cameras)): image_files(paths)}
    return [_batch(name, files, joints, by_order) for name, files in own.items()]


def _batch(camera: str, files: Sequence[Path], joints: JointTable, by_order: bool) -> Batch:
    stems = Counter(path.stem for path in files)
    twice = next((path for path in files if stems[path.stem] > 1), None)
    if twice is not None:
        what = "is named as another image of the call"
        raise InputError(twice, "", what, "give each its own name: it is the pose's")
    if by_order:
        if len(files) != len(joints.rows):
            what = f"has {len(joints.rows)} rows for {len(files)} images"
            raise InputError(joints.path, "", what, "by order, each image needs its row")
        rows = [replace(row, pose=p.stem) for row, p in zip(joints.rows, files, strict=True)]
        joints = replace(joints, rows=rows)
    shots = file_shots(files, {row.pose for row in joints.rows})
    return Batch(camera, files[0].parent, shots, joints)


def recorded_batches(
    path: Path, recordings: Sequence[Recording], cell: Cell, camera: str | None
) -> list[Batch]:
    """Recordings by camera: the one named, the only one, or whose name is in the topic's.

    Raises InputError.
    """
    cameras = cameras_of(cell)
    found: list[Batch] = []
    for own in recordings:
        parts = own.topic.split("/")
        known = [name for name in cameras if name in parts or len(cameras) == 1]
        name = camera or (known[0] if len(known) == 1 else "")
        if name not in cameras or name in [batch.camera for batch in found]:
            what = f"{own.topic} is of one of the cameras {', '.join(cameras)}"
            remedy = "give --topic and --instrument, and import each camera for itself"
            raise InputError("--topic", "", what, remedy)
        found.append(Batch(name, path, own.shots, own.joints))
    return found


def recorded_notes(recordings: Sequence[Recording], cell: Cell) -> list[str]:
    """What was taken of a recording, and whether its lens is the cell's."""
    notes = []
    for own in recordings:
        how = f"one at each of {own.stops} stops" if own.stops else "of a moving arm"
        notes.append(f"{own.topic}: {len(own.shots)} of {own.images} images taken, {how}")
    lenses = [own.lens for own in recordings if own.lens is not None]
    cameras = cameras_of(cell)
    if len(recordings) == len(cameras) == len(lenses) == 1:
        (camera,) = cameras.values()
        notes += [] if _alike(camera.lens.values, lenses[0]) else [_other_lens(lenses[0])]
    return notes


def _alike(a: Array, b: Array) -> bool:
    n = max(len(a), len(b))
    return bool(np.allclose(np.pad(a, (0, n - len(a))), np.pad(b, (0, n - len(b))), atol=1e-6))


def _other_lens(lens: Array) -> str:
    fx, fy, cx, cy, *bent = (f"{value:.6g}" for value in lens)
    return (
        "camera_info has another lens than the cell: "
        f"focal_px = [{fx}, {fy}], center_px = [{cx}, {cy}], distortion = [{', '.join(bent)}]"
    )


def joined_images(
    batches: Sequence[Batch],
    patterns: Sequence[Pattern],
    cell: Cell,
    partial: bool,
    seen: Callable[[Sighting, Any], None],
) -> Images:
    """Find the boards in all images, and join them with their joints.

    partial : leave out images without joints, and joints without images; seen : told of each image

    Raises InputError.
    """
    cameras, several = cameras_of(cell), len(cell.instruments) > 1
    lists, tables, sightings, joined = [], [], {}, []
    for own in batches:
        camera = cameras.get(own.camera)
        found = look(own.shots, patterns, None if camera is None else camera.image, seen)
        if partial:
            found = [_with_joints(one, own.joints) for one in found]
        points = point_list(own.path, found, patterns)
        bad = {one.shot.pose for one in found if one.reason}
        rows = [row for row in own.joints.rows if row.pose not in bad]
        tables.append(replace(own.joints, rows=rows or own.joints.rows))
        name = own.camera if several else None
        read = cell.read_names
        joined.append(join([points], tables[-1], partial=partial, markers=read, instrument=name))
        lists.append(points)
        sightings[own.camera] = found
    return Images(lists, batches[0].joints, together(joined), sightings)


def _with_joints(own: Sighting, joints: JointTable) -> Sighting:
    known = any(row.pose == own.shot.pose for row in joints.rows)
    return own if known or own.reason else replace(own, reason="no joints")


def together(joined: Sequence[Joined]) -> Joined:
    """Tables of several cameras as one, each pose once."""
    first, *rest = joined
    if not rest:
        return first
    markers: Counter[str] = Counter()
    for own in joined:
        markers.update(own.markers)
    poses = tuple(dict.fromkeys(pose for own in joined for pose in own.poses))
    missing = {pose for own in joined for pose in own.without_points} - set(poses)
    return replace(
        first,
        rows=[row for own in joined for row in own.rows],
        tried={k: sum(own.tried.get(k, 0) for own in joined) for k in first.tried},
        poses=poses,
        markers=dict(markers),
        without_points=tuple(sorted(missing)),
        without_joints={k: v for own in joined for k, v in own.without_joints.items()},
    )
