"""Images of boards, of files or a recording, imported: the table, its record, and a page to look at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib import Cell
from calib.errors import InputError
from calib.files.csv_table import csv_text
from calib.files.exports import JointTable
from calib.files.exports.bags import is_bag, recordings
from calib.files.exports.sightings import Sighting
from studies.command.deliver import check_outputs, progress_bar
from studies.imports.gallery import Gallery
from studies.imports.images import (
    Batch,
    file_batches,
    image_files,
    joined_images,
    patterns_of,
    recorded_batches,
    recorded_notes,
)
from studies.imports.read_back import read_back
from studies.imports.record import ImportRecord, import_record
from studies.record import envelope


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
        cell, patterns = self.cell, patterns_of(self.cell, self.boards)
        own = [] if self.joints is None else [self.joints.path]
        inputs = [*_files(self.paths), *own, cell.path, *cell.robot_files]
        check_outputs(outputs, inputs)
        gallery = Gallery() if page_path is not None else None
        with ExitStack() as stack:
            batches, notes = self._batches(cell, stack, topics, moving)
            total = sum(len(batch.shots) for batch in batches)
            bar = stack.enter_context(progress_bar(total, "looking for boards"))
            images = joined_images(batches, patterns, cell, self.partial, _told(bar, gallery))
        table = csv_text(images.joined.columns, images.joined.rows)
        every = len(cell.instruments) == 1 and not self.partial
        warnings = read_back(cell, table, table_path, every)
        record = import_record(
            images.lists, images.joints, images.joined, warnings,
            envelope(cell.name, inputs), images.seen, notes,
        )  # fmt: skip
        texts: dict[Path, str | bytes] = {table_path: table}
        if page_path is not None and gallery is not None:
            texts[page_path] = gallery.page(record, images.seen)
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


def _told(bar: Callable[[int], None], gallery: Gallery | None) -> Callable[[Sighting, Any], None]:
    def tell(own: Sighting, pixels: Any) -> None:
        bar(1)
        if gallery is not None:
            gallery.add(own, pixels)

    return tell
