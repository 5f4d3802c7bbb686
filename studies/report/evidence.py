"""What a report rests on: results, and the inputs they name as long as these are unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from calib import Cell, Measurements, load_cell, load_measurements
from calib.errors import CalibError, InputError
from calib.poses import Poses, poses_at
from studies.identify.telling import HELD_OUT
from studies.kinds import tell
from studies.record import Record
from studies.results.design import DesignResult
from studies.results.parts import read_joints
from studies.results.read import Input, located, read

if TYPE_CHECKING:
    from studies.document import Document

R = TypeVar("R", bound=Record)


@dataclass(frozen=True, eq=False)
class ReportedResult:
    """A result file.

    record : its content; inputs : tuple of Input, the cell first
    """

    path: Path
    record: Record
    inputs: tuple[Input, ...]

    @property
    def kind(self) -> str:
        """One of :data:`studies.results.KINDS`."""
        return self.record.kind

    @cached_property
    def told(self) -> Document:
        """What it says of itself."""
        return tell(self.record)


@dataclass(frozen=True, eq=False)
class MeasuredTables:
    """The measurements of a result, and those of the poses held out where they are another file."""

    data: Measurements
    heldout: Measurements | None

    def reading(self, name: str, heldout: bool) -> tuple[Poses, int] | None:
        """The poses that a row of the result is of, and its place among them; None where unknown."""
        own = self.heldout if heldout and self.heldout is not None else self.data
        plain = name.removesuffix(HELD_OUT)
        return (own.poses, own.poses.names.index(plain)) if plain in own.poses.names else None


@dataclass(frozen=True, eq=False)
class ReportEvidence:
    """All that a report is made of.

    results : tuple of ReportedResult, in the order given
    cell : Cell of the first result, None where its file is gone or changed
    data : dict, result file -> its measurements, where cell and tables are unchanged
    plans : dict, result file -> the poses of a design in this cell
    notes : tuple of str, what had to be left out, and why
    """

    results: tuple[ReportedResult, ...]
    cell: Cell | None
    data: dict[Path, MeasuredTables]
    plans: dict[Path, Poses]
    notes: tuple[str, ...]

    def of(self, kind: str) -> list[ReportedResult]:
        """The results of a kind."""
        return [result for result in self.results if result.kind == kind]

    def first(self, kind: str) -> ReportedResult | None:
        """The first result of a kind."""
        return next(iter(self.of(kind)), None)

    def record(self, kind: type[R]) -> R | None:
        """The first record of a type."""
        return next((own.record for own in self.results if isinstance(own.record, kind)), None)

    @property
    def mixed(self) -> tuple[str, ...]:
        """Warnings of files that are not the same in all results."""
        known: dict[str, tuple[str, Path]] = {}
        found = []
        for result in _of_one_cell(self.results):
            for entry in result.inputs:
                name = Path(entry.file).name
                digest, first = known.setdefault(name, (entry.sha256, result.path))
                if digest != entry.sha256:
                    found.append(
                        f"{name} is another file in {result.path.name} than in {first.name}: their "
                        "figures do not belong together."
                    )
        return tuple(dict.fromkeys(found))


def load_evidence(paths: Sequence[Path]) -> ReportEvidence:
    """Read results and what they were made from.

    Raises InputError where a file is no result of posecal, or misses what results of its kind hold.
    """
    results = tuple(_result(path) for path in paths)
    of_cell = _of_one_cell(results)
    cell, notes = _cell(of_cell) if of_cell else (None, [])
    data, plans = {}, dict[Path, Poses]()
    for result in of_cell:
        if (
            cell is None
            or not result.inputs
            or result.inputs[0].sha256 != of_cell[0].inputs[0].sha256
        ):
            continue
        if isinstance(result.record, DesignResult):
            plans[result.path] = plan_poses(cell, result.record, result.path)
        if result.kind in ("identify", "diagnose"):
            measured, lost = _measured(cell, result)
            notes += lost
            if measured is not None:
                data[result.path] = measured
    return ReportEvidence(results, cell, data, plans, tuple(dict.fromkeys(notes)))


def _of_one_cell(results: tuple[ReportedResult, ...]) -> tuple[ReportedResult, ...]:
    """Those whose inputs begin with a cell."""
    return tuple(result for result in results if result.record.of_one_cell)


def _measured(cell: Cell, result: ReportedResult) -> tuple[MeasuredTables | None, list[str]]:
    """The tables of a result, and what is missing of them."""
    sources = result.inputs[1 + len(cell.robot_files) :]
    holdout = getattr(result.record, "holdout", None)  # as the user gave it
    held = [source for source in sources[1:] if source.file == holdout]
    wanted = [*sources[:1], *held]
    lost = [
        f"{source.file} is {source.state}: figures that need it are left out"
        for source in wanted
        if source.path is None
    ]
    paths = [source.path for source in wanted if source.path is not None]
    if lost or not paths:
        return None, lost
    tables = [load_measurements(cell, path, every_marker=False) for path in paths]
    return MeasuredTables(tables[0], tables[1] if held else None), lost


def _result(path: Path) -> ReportedResult:
    record = read(path)
    inputs = tuple(located(path, entry.file, entry.sha256) for entry in record.inputs)
    return ReportedResult(path, record, inputs)


def _cell(results: tuple[ReportedResult, ...]) -> tuple[Cell | None, list[str]]:
    source = results[0].inputs[0] if results[0].inputs else None
    if source is None or source.path is None:
        what = "the cell" if source is None else f"{source.file} is {source.state}: the cell"
        return None, [f"{what}, its picture and what needs the robot are left out"]
    notes = [
        f"{result.path.name} was made from another cell than {results[0].path.name}"
        for result in results[1:]
        if result.inputs and result.inputs[0].sha256 != source.sha256
    ]
    try:
        return load_cell(source.path), notes
    except CalibError as error:
        return None, [*notes, f"{error}: the cell is left out"]


def plan_poses(cell: Cell, record: DesignResult, path: Path) -> Poses:
    """The poses of a design. Raises InputError where they are not of the cell's joints."""
    robot, first = cell.robot, record.poses[0]
    if {*first.joints_deg, *first.joints_mm} != set(robot.joints):
        joints = ", ".join(robot.joints)
        raise InputError(path, "poses", "name other joints than the cell", f"these are {joints}")
    q = np.array([read_joints(robot, pose) for pose in record.poses])
    return poses_at(q, [pose.pose for pose in record.poses])
