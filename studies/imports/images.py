"""Images of boards, of folders or recordings, imported: the table, its record, and a page of them."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from calib import Cell
from calib.errors import InputError
from calib.files.csv_table import csv_text
from calib.files.exports import Joined, JointTable, PointList
from calib.files.exports.bags import Recording, is_bag, recordings
from calib.files.exports.images import Pattern, opencv, pattern_of
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
from studies.command.deliver import check_outputs, progress_bar
from studies.document import Raw, Section
from studies.document.page import Writer, template
from studies.imports.record import ImportRecord, import_record, read_back
from studies.record import envelope
from studies.report.page import asset


@dataclass(frozen=True, eq=False)
class Batch:
    """Images of one camera and the joint values of their poses; path : where they come from."""

    camera: str
    path: Path
    shots: list[Shot]
    joints: JointTable


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
        known, told = camera.lens.values, lenses[0]
        most = max(len(known), len(told))
        one, other = (np.pad(values, (0, most - len(values))) for values in (known, told))
        if not np.allclose(one, other, atol=1e-6):
            fx, fy, cx, cy, *bent = (f"{value:.6g}" for value in told)
            notes.append(
                f"camera_info has another lens than the cell: focal_px = [{fx}, {fy}], "
                f"center_px = [{cx}, {cy}], distortion = [{', '.join(bent)}]"
            )
    return notes


def joined_images(
    batches: Sequence[Batch],
    patterns: Sequence[Pattern],
    cell: Cell,
    partial: bool,
    seen: Callable[[Sighting, Any], None],
) -> tuple[list[PointList], Joined, dict[str, list[Sighting]]]:
    """Find the boards in all images, and join them with their joints.

    partial : leave out images without joints, and joints without images; seen : told of each image

    Returns lists of points, the table, and what each image shows, by camera. Raises InputError.
    """
    cameras, several = cameras_of(cell), len(cell.instruments) > 1
    lists, sightings, joined = [], {}, []
    for own in batches:
        camera = cameras.get(own.camera)
        found = look(own.shots, patterns, None if camera is None else camera.image, seen)
        if partial:
            known = {row.pose for row in own.joints.rows}
            found = [
                one if one.shot.pose in known or one.reason else replace(one, reason="no joints")
                for one in found
            ]
        points = point_list(own.path, found, patterns)
        bad = {one.shot.pose for one in found if one.reason}
        rows = [row for row in own.joints.rows if row.pose not in bad]
        table = replace(own.joints, rows=rows or own.joints.rows)
        name = own.camera if several else None
        read = cell.read_names
        joined.append(join([points], table, partial=partial, markers=read, instrument=name))
        lists.append(points)
        sightings[own.camera] = found
    return lists, together(joined), sightings


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


@dataclass(frozen=True, eq=False)
class BoardImport:
    """What is to be imported: image files and folders with joints, or one recording without.

    boards : names of the cell's; camera : where the cell has several, or None
    by_order, partial : as :func:`calib.files.exports.join.join` has them
    """

    paths: Sequence[Path]
    boards: Sequence[str]
    cell: Cell | None
    joints: JointTable | None
    camera: str | None
    by_order: bool
    partial: bool

    def run(
        self,
        table_path: Path,
        outputs: Sequence[Path | None],
        page_path: Path | None,
        topics: Sequence[str],
        moving: bool,
    ) -> tuple[ImportRecord, dict[Path, str | bytes]]:
        """The record, and the texts of the files to write. Raises InputError."""
        if self.cell is None:
            remedy = "give --cell CELL, whose [boards] say what is printed"
            raise InputError("--board", "", "names a board of a cell", remedy)
        cell, patterns = self.cell, [pattern_of(self.cell.path, name) for name in self.boards]
        own = [] if self.joints is None else [self.joints.path]
        inputs = [*_files(self.paths), *own, cell.path, *cell.robot_files]
        check_outputs(outputs, inputs)
        gallery = Gallery() if page_path is not None else None
        with ExitStack() as stack:
            batches, notes = self._batches(cell, stack, topics, moving)
            total = sum(len(batch.shots) for batch in batches)
            bar = stack.enter_context(progress_bar(total, "looking for boards"))

            def seen(own: Sighting, pixels: Any) -> None:
                bar(1)
                if gallery is not None:
                    gallery.add(own, pixels)

            lists, joined, shown = joined_images(batches, patterns, cell, self.partial, seen)
        table = csv_text(joined.columns, joined.rows)
        every = len(cell.instruments) == 1 and not self.partial
        warnings = read_back(cell, table, table_path, every)
        record = import_record(
            lists, batches[0].joints, joined, warnings, envelope(cell.name, inputs), shown, notes,
        )  # fmt: skip
        texts: dict[Path, str | bytes] = {table_path: table}
        if page_path is not None and gallery is not None:
            texts[page_path] = gallery.page(record, shown)
        return record, texts

    def _batches(
        self, cell: Cell, stack: ExitStack, topics: Sequence[str], moving: bool
    ) -> tuple[list[Batch], list[str]]:
        """The images of each camera, and what was taken of a recording."""
        bags = [path for path in self.paths if is_bag(path)]
        if not bags:
            if topics or moving:
                option = "--topic" if topics else "--moving"
                raise InputError(option, "", "is of recordings, these are images", "leave it out")
            if self.joints is None:
                raise InputError("--joints", "", "is missing", "give the joint values of the poses")
            return file_batches(self.paths, self.joints, cell, self.camera, self.by_order), []
        if len(self.paths) > 1:
            raise InputError(bags[0], "", "is a recording beside others", "import one at a time")
        if self.joints is not None:
            what = f"is given beside {bags[0]}, which holds the joints"
            raise InputError("--joints", "", what, "leave it out")
        own = stack.enter_context(recordings(bags[0], cell.robot, topics, moving))
        return recorded_batches(bags[0], own, cell, self.camera), recorded_notes(own, cell)


def _files(paths: Sequence[Path]) -> list[Path]:
    """Files of what is given: of a recording's folder all of it, of other folders their images."""
    found: list[Path] = []
    for path in paths:
        if is_bag(path):
            found += sorted(path.iterdir()) if path.is_dir() else [path]
        else:
            found += image_files([path])
    return found


_WIDTH = 420  # px, of an image on the page
_QUALITY = 80  # per cent, of JPEG
_COLOURS = ((0, 158, 230), (180, 105, 0), (115, 158, 0))  # BGR, of boards: orange, blue, green
_CSS = """.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(15rem,1fr));gap:1rem}
.shots figure{margin:0}.shots img{width:100%;height:auto;display:block}
.shots .bad img{opacity:.55}.shots .bad figcaption{font-weight:600}"""


class Gallery:
    """Small images with what was found in them, in the order in which they are added."""

    def __init__(self) -> None:
        self.images: list[bytes] = []

    def add(self, own: Sighting, pixels: Any) -> None:
        """One image: crosses at the points, a colour for each board."""
        cv2 = opencv("--page")
        scale = _WIDTH / pixels.shape[1]
        small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        drawn = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
        for k, (_, at) in enumerate(own.boards.values()):
            for u, v in np.rint(at * scale).astype(int).tolist():
                colour = _COLOURS[k % len(_COLOURS)]
                cv2.drawMarker(drawn, (u, v), colour, cv2.MARKER_CROSS, 9, 2, cv2.LINE_AA)
        _, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        self.images.append(data.tobytes())

    def page(self, record: ImportRecord, seen: Mapping[str, Sequence[Sighting]]) -> str:
        """The page as HTML that names nothing outside itself."""
        from studies.kinds import tell

        writer, images = Writer.fresh(), iter(self.images)
        sections = [replace(own, key="summary") for own in tell(record).sections]
        for camera, every in seen.items():
            shown = Markup("\n").join(_figure(own, next(images)) for own in every)
            grid = Markup('<div class="shots">{}</div>').format(shown)
            title = f"Images of {camera}" if camera else "Images"
            sections.append(Section(f"images-{camera}", title, (Raw(grid),)))
        return template("studies.report", "page.html.j2").render(
            title="Imported images",
            told={"cell": record.cell},
            sections=[(own, writer.section(own, {})) for own in sections],
            styles=[asset("page.css"), Markup(_CSS)],  # noqa: S704
            scripts=[],
        )


def _figure(own: Sighting, image: bytes) -> Markup:
    said = ", ".join(f"{name} {len(ids)}" for name, (ids, _) in own.boards.items())
    text = f"{own.shot.pose}: {own.reason or said}"
    data = base64.b64encode(image).decode("ascii")
    return Markup(
        '<figure{}><img alt="{}" src="data:image/jpeg;base64,{}"><figcaption>{}</figcaption></figure>'
    ).format(Markup(' class="bad"' if own.reason else ""), text, data, text)  # noqa: S704
