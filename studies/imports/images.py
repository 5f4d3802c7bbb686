"""Images of boards as lists of pixels, and the joint values that belong to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from calib.errors import InputError
from calib.files.exports import JointTable, PointList
from calib.files.exports.images import IMAGES, pattern_of, read_images


def image_files(paths: Sequence[Path]) -> list[Path]:
    """Images as given, and all of a folder in the order of their names. Raises InputError."""
    found: list[Path] = []
    for path in paths:
        own = [path]
        if path.is_dir():
            own = sorted(file for file in path.iterdir() if file.suffix.lower() in IMAGES)
            if not own:
                raise InputError(path, "", "holds no images", f"give {', '.join(IMAGES)}")
        found += own
    stems = [path.stem for path in found]
    twice = next((path for path in found if stems.count(path.stem) > 1), None)
    if twice is not None:
        what = "is named as another image of the call"
        raise InputError(twice, "", what, "give each its own name: it is the pose's")
    return found


def images_and_joints(
    paths: Sequence[Path],
    boards: Sequence[str],
    cell: Path | None,
    joints: JointTable,
    by_order: bool,
) -> tuple[list[PointList], JointTable]:
    """Points of the boards in images, and the joint values of the images that show one.

    by_order : the k-th image stands in the k-th row of the joint file

    Raises InputError.
    """
    if cell is None:
        what = "names a board of a cell"
        raise InputError(
            "--board", "", what, "give --cell CELL, whose [boards] say what is printed"
        )
    patterns = [pattern_of(cell, name) for name in boards]
    if by_order:
        if len(paths) != len(joints.rows):
            what = f"has {len(joints.rows)} rows for {len(paths)} images"
            raise InputError(joints.path, "", what, "by order, each image needs its row")
        rows = [replace(row, pose=p.stem) for row, p in zip(joints.rows, paths, strict=True)]
        joints = replace(joints, rows=rows)
    read, blank = read_images(paths, patterns, {row.pose for row in joints.rows})
    rows = [row for row in joints.rows if row.pose not in blank]
    return [read], replace(joints, rows=rows or joints.rows)
