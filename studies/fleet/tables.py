"""Tables below a folder: which belong to which cell, and the results of each, kept or made.

Results go to files where they are made, so that what travels and what stays in memory is small.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.errors import CalibError, InputError, plain_line
from calib.threads import one_blas_thread
from studies.fleet.record import NamedEntry

if TYPE_CHECKING:
    from studies.command.session import MeasuredTable
    from studies.identify.record import IdentifyRecord
    from studies.record import Record


_CELL = "cell"
_ROBOT = re.compile(r"^\s*\[robot\]", re.MULTILINE)
_MOST = 2_000_000  # characters; a larger TOML is no cell
_DATE = re.compile(r"(?<!\d)(20\d\d)([-_.]?)(\d\d)\2(\d\d)(?!\d)")


@dataclass(frozen=True)
class TableJob:
    """A table of a robot.

    robot : name of the robot, the place of its cell below the folder
    table : None where the cell has none; label : its place below the folder
    day : YYYY-MM-DD, of its name or of the folders between it and the cell; None where there is none
    """

    robot: str
    cell: Path
    table: Path | None
    label: str
    day: str | None

    def result(self, verb: str) -> Path:
        """Where a result of it stands: beside the table, named after it."""
        table = self.table or self.cell
        known = self.cell.stem == _CELL or table.stem.startswith(self.cell.stem)
        stem = table.stem if known else f"{table.stem}.{self.cell.stem}"
        return table.with_name(f"{stem}.{verb}.json")


def find(folder: Path, without: str | None = None) -> list[TableJob]:
    """Every cell below a folder with its tables, in the order of names.

    without : file name of tables that hold poses out and are no measurements of their own

    A table belongs to the next cell at or above it. Where several stand in one folder, it belongs to
    the one whose name its own begins with, else to each.
    """
    jobs = []
    cells: dict[Path, list[Path]] = {}
    tables: dict[Path, list[Path]] = {}
    for place, files in _walk(folder):
        own = [place / name for name in files if name.endswith(".toml")]
        cells[place] = [path for path in own if _is_cell(path)] or cells.get(place.parent, [])
        for name in files:
            if name.endswith(".csv") and name != without:
                _assign(place / name, cells[place], tables)
        jobs += [path for path in own if path in cells[place]]
    return [job for cell in sorted(jobs) for job in _jobs(folder, cell, tables.get(cell, []))]


def _walk(folder: Path) -> Iterator[tuple[Path, list[str]]]:
    """Folders from the top down, hidden ones left out."""
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield Path(place), sorted(name for name in files if not name.startswith("."))


def _is_cell(path: Path) -> bool:
    """Whether a TOML describes a cell, well or badly."""
    if path.stem == _CELL:
        return True
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return _ROBOT.search(file.read(_MOST)) is not None
    except OSError:
        return False


def _assign(table: Path, cells: list[Path], tables: dict[Path, list[Path]]) -> None:
    from calib.files.tables import holds_points

    if not cells or not holds_points(table):
        return
    named = [cell for cell in cells if table.name.startswith(cell.stem)]
    longest = [max(named, key=lambda cell: len(cell.stem))] if named else cells
    for cell in longest:
        tables.setdefault(cell, []).append(table)


def _jobs(folder: Path, cell: Path, tables: list[Path]) -> Iterator[TableJob]:
    place = cell.relative_to(folder)
    robot = place.parent if cell.stem == _CELL else place.with_suffix("")
    name = robot.as_posix() if robot.parts else folder.resolve().name
    if not tables:
        yield TableJob(name, cell, None, "", None)
    for table in sorted(tables):
        label = table.relative_to(folder).as_posix()
        yield TableJob(name, cell, table, label, _day(table.relative_to(cell.parent).as_posix()))


def _day(name: str) -> str | None:
    """The last date that a name holds.

    >>> _day("2026-03-01/measurements.csv"), _day("r7_20260301.csv"), _day("r7_20261350.csv")
    ('2026-03-01', '2026-03-01', None)
    """
    for year, _, month, day in reversed(_DATE.findall(name)):
        try:
            return date(int(year), int(month), int(day)).isoformat()
        except ValueError:
            continue
    return None


Verb: TypeAlias = Literal["identify", "diagnose"]
VERBS: tuple[Verb, ...] = ("identify", "diagnose")


@dataclass(frozen=True)
class FleetTask:
    """What is wanted of every table; holdout : a share, or the name of a file beside it.

    learning : whether a type is learnt from the results: then sizes found from one robot hold nothing
    """

    verbs: tuple[Verb, ...]
    holdout: str | None
    seed: int
    learning: bool = False

    def holdout_of(self, table: Path) -> str | None:
        """The share, or the file's path."""
        return self.holdout if share(self.holdout) else str(table.parent / str(self.holdout))


def share(holdout: str | None) -> bool:
    """Whether poses are held out by a share, or not at all, and not by a file."""
    try:
        float(holdout or 0.0)
    except ValueError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class Values:
    """Identified parameters of the robot itself, base and markers left out.

    value, std : ndarray, shape (p,), in the units of the results; std 0 where it was not estimated
    """

    names: tuple[tuple[str, str], ...]  # with the unit of each
    value: Array
    std: Array


@dataclass
class TableOutcome:
    """What became of a table: ``fault`` is a line where something could not be done.

    cell : its file; nominal : hashes of the files of its nominal model
    files : results with their sha256; kept : how many of them stood already
    """

    robot: str
    table: str
    cell: str = ""
    type: str = ""
    nominal: tuple[str, ...] = ()
    day: str | None = None
    fault: str | None = None
    status: str | None = None
    poses: int | None = None
    rms_mm: dict[str, float | None] = field(default_factory=dict)
    sigma_mm: float | None = None
    pixel_mm: float | None = None
    values: Values | None = None
    verdict: str | None = None
    causes: tuple[NamedEntry, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    kept: int = 0


@one_blas_thread
def do(job: TableJob, asked: FleetTask) -> TableOutcome:
    """Identify and diagnose a table, or read what stands of it. A fault is a line of the answer.

    So is one of our own code: a run of hours does not end by it, and the command named shows it.
    """
    done = TableOutcome(job.robot, job.label, str(job.cell), day=job.day)
    try:
        _do(job, asked, done)
    except CalibError as error:
        done.fault = str(error)
    except Exception as error:
        said = plain_line(f"{type(error).__name__}: {error}")
        verb = asked.verbs[min(len(done.files), len(asked.verbs) - 1)]
        done.fault = (
            f"a fault of posecal itself ({said}); posecal {verb} {job.cell} {job.table} shows where"
        )
    return done


def _do(job: TableJob, asked: FleetTask, done: TableOutcome) -> None:
    import calib
    from calib.files.read import sha256
    from calib.files.write import write_files
    from studies.command.session import day_of, read_session
    from studies.diagnose.make import diagnosed
    from studies.diagnose.record import DiagnoseRecord
    from studies.identify.make import identified
    from studies.identify.record import IdentifyRecord

    cell = calib.load_cell(job.cell)
    if asked.learning and cell.size_prior == "estimated":
        cell = replace(cell, size_prior="off")
    done.type = cell.robot.name
    done.nominal = tuple(map(sha256, cell.robot_files))
    if job.table is None:
        raise InputError(job.cell, "", "has no table of measurements", "put one beside or below it")
    session = read_session(cell, job.table, asked.holdout_of(job.table), asked.seed)
    done.day = job.day or day_of(session.whole.poses)
    for verb in asked.verbs:
        path = job.result(verb)
        record = _kept(path, verb, session)
        done.kept += record is not None
        if record is None:
            make = identified if verb == "identify" else diagnosed
            _, record = make(session)
            write_files({path: record.dumps()})
        done.files += ((str(path), sha256(path)),)
        if isinstance(record, IdentifyRecord):
            _identified(record, done)
        elif isinstance(record, DiagnoseRecord):
            done.verdict = record.verdict
            done.causes = tuple(
                NamedEntry.from_result(e, alike=dict.fromkeys((e.key, *(c.key for c in e.alike))))
                for e in record.effects
            )


def _kept(path: Path, verb: Verb, session: MeasuredTable) -> Record | None:
    """The result that stands, if the same version made it from the same contents and options."""
    from calib.files.read import sha256
    from studies.diagnose import make as diagnosis
    from studies.identify import make as identification
    from studies.record import envelope
    from studies.results import read

    if not path.is_file():
        return None
    made = {"identify": identification, "diagnose": diagnosis}[verb]
    try:
        record = read(path)
    except InputError:
        return None
    now = envelope(session.cell.name, [], session.seed)
    same = (
        record.kind == verb
        and (record.version, record.seed) == (now["version"], session.seed)
        and _as_asked(record, session)
        and [e.sha256 for e in record.inputs] == [*map(sha256, made.inputs_of(session))]
    )
    return record if same else None


def _as_asked(record: Record, session: MeasuredTable) -> bool:
    """Whether its options are those of this run: a user may have put a result there by others."""
    from studies.diagnose.record import DiagnoseRecord
    from studies.identify.record import IdentifyRecord

    if isinstance(record, IdentifyRecord):
        plain = (record.approach, record.method, record.differences) == ("points", "joint", False)
        held = record.sizes is None or session.cell.size_prior != "off"
        return plain and held and record.holdout == session.holdout
    return isinstance(record, DiagnoseRecord) and record.holdout == session.holdout


def _identified(record: IdentifyRecord, done: TableOutcome) -> None:
    done.status, done.poses, done.sigma_mm = record.status, record.poses, record.noise.sigma_mm
    done.pixel_mm = pixel = record.noise.pixel_mm
    keys = {"nominal": "nominal", "fitted": "fitted_all", "heldout": "heldout"}
    done.rms_mm = {key: getattr(record.rms_mm, own) for key, own in keys.items()}
    if pixel is not None:
        done.rms_mm = {key: _at_points(record, own, pixel) for key, own in keys.items()}
    own = [p for p in record.parameters if not p.placed]
    done.values = Values(
        tuple((p.id, p.unit) for p in own),
        np.array([p.value for p in own]),
        np.array([p.std or 0.0 for p in own]),
    )


def _at_points(record: IdentifyRecord, key: str, pixel_mm: float) -> float | None:
    """An error of cameras alone in mm at the points; of several cameras that of the worst."""
    of_each = [getattr(own, key) for own in record.instruments if own.unit == record.noise.unit]
    return max((pixel_mm * px for px in of_each if px is not None), default=None)
