"""A CSV file as columns of checked numbers; every fault names its line and column."""

from __future__ import annotations

import csv
import difflib
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.read import ORDER, check_file
from calib.keys import fault_of_name

_LARGEST_FILE = 100_000_000  # bytes, some 700 000 rows, a gigabyte in memory
_LARGEST_NUMBER = 1e12  # in any unit
_REMEDY = "leave the row out if it was not measured"
_COMMENT = re.compile(r"#(\s|#|[^,]*$)")  # a pose may be named #1
_SHOWN = 6
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_DIGITS = re.compile(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?", re.ASCII)
_MARKS = {";": "semicolons", "\t": "tabs", " ": "blanks"}
LONGEST_LINE = 65_536
"""Characters; a longer line is none of a table of numbers."""


@dataclass(frozen=True)
class CsvTable:
    """A CSV file as columns of text, with the line of each row.

    remedy : what to do with what is no number
    """

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    remedy: str = _REMEDY

    def text(self, column: str) -> list[str]:
        i = self.columns.index(column)
        return [row[i].strip() for row in self.rows]

    def names(self, column: str) -> list[str]:
        """A column of names that can be shown; raises InputError naming line and column."""
        names = self.text(column)
        faults = {name: fault for name in set(names) if (fault := fault_of_name(name))}
        for row, name in enumerate(names if faults else ()):
            if name in faults:
                raise self.fault(row, column, faults[name], "give it a short, plain name")
        return names

    def refuse_twice(self, column: str, remedy: str) -> None:
        """Raises InputError where two rows have the same name."""
        seen = set[str]()
        for row, name in enumerate(self.text(column)):
            if name in seen:
                raise self.fault(row, column, f"{name!r} stands twice", remedy)
            seen.add(name)

    def numbers(self, column: str, rows: IntArray | None = None, remedy: str = "") -> Array:
        """A column of finite numbers, of some rows; raises InputError naming line and column."""
        i = self.columns.index(column)
        chosen = range(len(self.rows)) if rows is None else rows.tolist()
        try:
            values = np.fromiter((float(self.rows[r][i]) for r in chosen), float, len(chosen))
        except ValueError:
            values = np.array([self._number(i, r) for r in chosen])
        for k in np.flatnonzero(~(np.abs(values) < _LARGEST_NUMBER))[:1]:
            what = f"{self.rows[chosen[k]][i][:40]!r} is not a finite number of plausible size"
            raise self.fault(chosen[k], column, what, remedy or self.remedy)
        return values

    def _number(self, column: int, row: int) -> float:
        cell, remedy = self.rows[row][column].strip(), self.remedy
        try:
            return float(cell)
        except ValueError:
            if _DECIMAL_COMMA.fullmatch(cell):
                remedy = "write decimal points, as in 1.5"
            elif row == 0 and not any(_DIGITS.fullmatch(text.strip()) for text in self.rows[0]):
                remedy = f"line {self.lines[0]} is a second title line: delete it"
            what = f"{cell[:40]!r} is not a number" if cell else "is empty"
            raise self.fault(row, self.columns[column], what, remedy) from None

    def fault(self, row: int, column: str, what: str, remedy: str = "") -> InputError:
        return InputError(self.path, f"line {self.lines[row]}, column {column}", what, remedy)


def read_table(
    path: Path,
    required: Sequence[str],
    check: Callable[[tuple[str, ...]], None],
    rows_are: str = "poses",
    remedy: str = _REMEDY,
) -> CsvTable:
    """The whole table but for empty rows; the header is checked before any row is read."""
    rows, lines = list[list[str]](), list[int]()
    columns, each = read_rows(path, required, check)
    for line, row in each:
        if rows:  # what a pose repeats in each of its rows is kept once
            row = [old if old == new else new for old, new in zip(rows[-1], row, strict=True)]
        rows.append(row)
        lines.append(line)
    if not rows:
        raise InputError(path, "", "has a header and no rows", f"add the {rows_are}")
    return CsvTable(path, columns, rows, lines, remedy)


def read_rows(
    path: Path,
    required: Sequence[str],
    check: Callable[[tuple[str, ...]], None],
    largest: int = _LARGEST_FILE,
) -> tuple[tuple[str, ...], Iterator[tuple[int, list[str]]]]:
    """The columns of a table, and line and cells of each of its rows as they are asked for.

    check : of the columns; largest : bytes of the file

    Raises InputError, the iterator as well.
    """
    check_file(path, largest)
    reader = csv.reader(_bounded_lines(path), strict=True)
    with _faults_of_text(path, lambda: reader.line_num):
        columns = _header(path, reader, required)
        check(columns)

    def each() -> Iterator[tuple[int, list[str]]]:
        with _faults_of_text(path, lambda: reader.line_num):
            for row in filter(any, reader):
                if len(row) != len(columns):
                    more = len(row) > len(columns)
                    how = "write decimal points, not commas, and nothing more"
                    what = f"has {len(row)} fields, the header {len(columns)}"
                    where = f"line {reader.line_num}"
                    raise InputError(path, where, what, how if more else "complete the row")
                yield reader.line_num, row

    return columns, each()


@contextmanager
def _faults_of_text(path: Path, line: Callable[[], int]) -> Iterator[None]:
    """What is no text or no CSV, as InputError."""
    try:
        yield
    except UnicodeDecodeError:
        raise InputError(path, "", "is not text in UTF-8", "export it as CSV") from None
    except csv.Error as error:
        where, what = f"line {line()}", f"is no CSV ({error})"
        raise InputError(path, where, what, "check the quotation marks") from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})", "check the path") from None


def _bounded_lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), ""), 1):
            if number == 1 and line.startswith("{"):
                raise InputError(path, "", "is a JSON and no table", ORDER)
            if "\0" in line or len(line) >= LONGEST_LINE:
                what = "is no line of a CSV table"
                raise InputError(path, f"line {number}", what, "export it as CSV")
            yield "\n" if _COMMENT.match(line) else line


def _header(path: Path, reader: Iterator[list[str]], required: Sequence[str]) -> tuple[str, ...]:
    """The names of the columns. Raises InputError."""
    columns = tuple(name.strip() for name in next(filter(None, reader), []))
    if not any(columns):
        raise InputError(path, "", "is empty", "the first line must name the columns")
    for name in columns:
        if name and columns.count(name) > 1:
            raise InputError(path, "line 1", f"column {name!r} stands twice", "keep one")
    for name in required:
        if name not in columns:
            what, below = f"column {name!r} is missing", next(reader, [])
            raise InputError(path, "line 1", what, _how_to_name(name, columns, below))
    return columns


def columns_of(path: Path) -> set[str]:
    """The columns of a table, to know its kind; none where whoever reads it says what is wrong."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return {name.strip() for name in next(csv.reader([file.readline(LONGEST_LINE)]), [])}
    except (OSError, ValueError, csv.Error):
        return set()


def _how_to_name(name: str, columns: tuple[str, ...], below: list[str]) -> str:
    """What to do where a column is missing that the header, or the next line, may have."""
    for mark, called in _MARKS.items():
        if name in (own.strip() for own in ",".join(columns).split(mark)):
            return f"the columns are separated by {called}: save it with commas and decimal points"
    if name in (own.strip() for own in below):
        return "line 1 is a title: delete it, line 2 names the columns"
    alike = [c for c in columns if c.casefold() == name.casefold()]
    alike = alike or difflib.get_close_matches(name, columns, n=1, cutoff=0.8)
    if alike:
        return f"write {alike[0]!r} as {name!r}"
    shown = ", ".join(repr(c[:40]) for c in columns[:_SHOWN]) + (" .." if columns[_SHOWN:] else "")
    return f"add it, or rename the one that holds it among {shown}"


def csv_text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The text of a CSV table."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *rows])
    return out.getvalue()


def columns_text(columns: Mapping[str, Sequence[str]]) -> str:
    """The text of a CSV table of columns that are equally long."""
    return csv_text(list(columns), zip(*columns.values(), strict=True))
