"""An exported text file as rows of fields, whatever separates them, and its units.

Commas, semicolons, tabs or blanks between the fields; a comma as decimal mark where it cannot be
anything else; UTF-8 or UTF-16 with a byte order mark, else UTF-8, else Windows-1252 as older
programs write; comment lines begin with ``//``, ``#`` or ``'``.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

from calib.errors import InputError
from calib.files.read import read_bytes

_TO_MM = {"mm": Decimal(1), "m": Decimal("1E3"), "in": Decimal("25.4")}

_NAMES = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "in": ("in", "inch", "inches"),
}
_SPELT = {name: unit for unit, names in _NAMES.items() for name in names}
_OTHERS = ("deg", "degree", "degrees", "°", "rad", "radians", "s", "degc", "°c")
_STATED = re.compile(r"\b(?:units?|einheit(?:en)?)\b[\s:=]*[\[(]?\s*([A-Za-z]+)", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"[\[(]\s*([A-Za-z]+)\s*[\])]")


def known_unit(text: str) -> str | None:
    """``mm``, ``m`` or ``in`` for any usual spelling, None for what is no such unit."""
    return _SPELT.get(text.lower())


def is_unit(text: str) -> bool:
    """Whether a field is the unit of a column and no name of one."""
    return known_unit(text.strip("[]()")) is not None or text.strip("[]()").lower() in _OTHERS


def stated_units(comments: Iterable[str]) -> set[str]:
    """Units that comment lines state, as ``Units: mm`` or, beside X, Y and Z, as ``[mm]``."""
    found = set()
    for line in comments:
        words = _STATED.findall(line)
        if {"x", "y", "z"} <= set(re.findall(r"\b[xyz]\b", line.lower())):
            words += _IN_BRACKETS.findall(line)
        found |= {unit for word in words if (unit := known_unit(word)) is not None}
    return found


def in_mm(number: str, unit: str) -> str:
    """The text of a number in millimetres: unchanged from mm, multiplied exactly from m and in.

    >>> in_mm("1.2345678901", "m"), in_mm("-2", "in"), in_mm("1.50", "mm")
    ('1234.5678901', '-50.8', '1.50')
    """
    if unit == "mm":
        return number
    return format(Decimal(number) * _TO_MM[unit], "f")


_LARGEST_FILE = 20_000_000  # bytes, some 300 000 points; they take half a gigabyte
_LONGEST_LINE = 65_536  # characters
_COMMENTS = ("//", "#", "'")
_SAMPLE = 50  # lines that decide on the separator
_MOST_TITLES = 5  # lines above the first number
_FEW = 0.5  # of the lines at most are titles: else names stand where numbers should
_LARGEST_NUMBER = 1e12  # in any unit

NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d{1,3})?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)


@dataclass(frozen=True)
class ExportTable:
    """Rows of text fields, all of the same length, with the line of each.

    comments : lines before the first row, without their mark
    header : names of the columns, None where the first row holds numbers already
    separator : ``,`` ``;`` tab, or a blank for any number of them
    decimal : ``.`` or ``,``
    """

    path: Path
    comments: tuple[str, ...]
    header: tuple[str, ...] | None
    rows: list[list[str]]
    lines: list[int]
    separator: str
    decimal: str

    def number(self, row: int, column: int) -> str:
        """A field as the text of a finite number with a decimal point, its digits unchanged."""
        text = self.rows[row][column]
        number = self._pointed(text)
        if number is None or not abs(float(number)) < _LARGEST_NUMBER:
            mark = " with a decimal comma, as others of this file" if self.decimal == "," else ""
            what = f"{text[:40]!r} is no number{mark}" if text else "a number is missing"
            raise self.fault(row, f"field {column + 1}: {what}")
        return number

    def holds_numbers(self, column: int) -> bool:
        """Whether every field of a column is a number."""
        return all(self.is_number(row, column) for row in range(len(self.rows)))

    def is_number(self, row: int, column: int) -> bool:
        return self._pointed(self.rows[row][column]) is not None

    def split(self, text: str) -> tuple[str, ...]:
        """The fields of a comment, none where it cannot be split."""
        try:
            return tuple(_fields(text, self.separator))
        except csv.Error:
            return ()

    def pointed(self, text: str) -> str:
        """A number with a decimal point; any other text as it is."""
        return self._pointed(text) or text

    def fault(self, row: int, what: str, remedy: str = "") -> InputError:
        return InputError(self.path, f"line {self.lines[row]}", what, remedy)

    def _pointed(self, text: str) -> str | None:
        if self.decimal == ",":
            text = "" if "." in text else text.replace(",", ".")
        return text if NUMBER.fullmatch(text) else None


def read_sheet(path: Path) -> ExportTable:
    """The file as a sheet. Raises InputError naming the line that does not fit."""
    comments: list[str] = []
    numbered: list[tuple[int, str]] = []
    for number, line in text_lines(path):
        if line.startswith(_COMMENTS):
            if not numbered:
                comments.append(line.lstrip("/#'").strip())
        else:
            numbered.append((number, line))
    if not numbered:
        raise InputError(path, "", "holds no data", "export it again")
    below = _MOST_TITLES if len(numbered) > 2 * _MOST_TITLES else 0
    separator = _separator([line for _, line in numbered[below : below + _SAMPLE]])
    rows: list[list[str]] = []
    for number, line in numbered:
        try:
            rows.append(_fields(line, separator))
        except csv.Error as error:
            raise InputError(path, f"line {number}", f"cannot be split ({error})") from None
    titles, rows, lines = _below_titles(rows, [number for number, _ in numbered])
    return made_sheet(path, [*comments, *titles], rows, lines, separator)


def made_sheet(
    path: Path, comments: list[str], rows: list[list[str]], lines: list[int], separator: str
) -> ExportTable:
    """Fields as a sheet: decimal mark and header found, lengths checked. Raises InputError."""
    width = len(rows[0])
    for number, row in zip(lines, rows, strict=True):
        while len(row) > width and not row[-1]:
            row.pop()
        if len(row) != width:
            what = f"has {len(row)} fields where line {lines[0]} has {width}"
            remedy = "separate fields alike, quote names with blanks"
            raise InputError(path, f"line {number}", what, remedy)
    decimal = _decimal(path, rows, lines)  # between commas only a quoted field holds one
    sheet = ExportTable(path, tuple(comments), None, rows, lines, separator, decimal)
    if any(sheet._pointed(field) is not None for field in rows[0]):
        return sheet
    if len(rows) == 1:
        raise InputError(path, "", "has a header and no rows", "export it again")
    return replace(sheet, header=tuple(rows[0]), rows=rows[1:], lines=lines[1:])


def _below_titles(
    rows: list[list[str]], lines: list[int]
) -> tuple[list[str], list[list[str]], list[int]]:
    """Titles above the names of the columns, and the rows from these names on.

    A line of units below the names is joined with them, as in ``x [mm]``.
    """
    leading = 0
    while leading < min(len(rows), _MOST_TITLES + 1) and not any(map(_numeric, rows[leading])):
        leading += 1
    if not 1 <= leading <= _FEW * len(rows):
        return [], rows, lines
    if 2 * len(rows[leading - 1]) <= len(rows[leading]):  # titles, and no names of columns
        return [" ".join(row) for row in rows[:leading]], rows[leading:], lines[leading:]
    if leading == 1:
        return [], rows, lines
    header = leading - 1
    units = rows[header]
    if all(is_unit(unit) for unit in units if unit) and any(units):
        header -= 1
        names = rows[header]
        if len(names) == len(units):
            joined = [_with_unit(n, u) for n, u in zip(names, units, strict=True)]
            rows = [*rows[:header], joined, *rows[leading:]]
            lines = [*lines[: header + 1], *lines[leading:]]
    titles = [" ".join(filter(None, row)) for row in rows[:header]]
    return titles, rows[header:], lines[header:]


def _with_unit(name: str, unit: str) -> str:
    """A name with its unit in brackets, unless it ends in one already."""
    known = not unit or is_unit(name.rpartition("_")[2]) or name.endswith(("]", ")"))
    return name if known else f"{name} [{unit.strip('[]()')}]"


def _numeric(field: str) -> bool:
    return bool(NUMBER.fullmatch(field) or _COMMA_NUMBER.fullmatch(field))


def text_lines(path: Path) -> list[tuple[int, str]]:
    """Lines that are not empty, stripped, with their numbers from 1. Raises InputError."""
    data = read_bytes(path, _LARGEST_FILE)
    try:
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            text = data.decode("utf-16")
        else:
            text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.encoding.startswith("utf-16"):
            what = "is no text in UTF-16"
            raise InputError(path, "", what, "export it as UTF-8") from None
        text = data.decode("cp1252", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    found = []
    for number, line in enumerate(text.split("\n"), start=1):
        if "\0" in line or len(line) > _LONGEST_LINE:
            raise InputError(path, f"line {number}", "is no line of a text table", "export as text")
        if line.strip():
            found.append((number, line.strip()))
    return found


def _separator(sample: list[str]) -> str:
    for mark in (";", "\t"):
        if all(mark in line for line in sample):
            return mark
    # In ``P1 1975,57 -310,20 -257,87`` no comma stands next to a blank.
    decimal = sum(_COMMA_NUMBER.fullmatch(word) is not None for word in sample[-1].split())
    return "," if all("," in line for line in sample) and decimal < 3 else " "


def _fields(line: str, separator: str) -> list[str]:
    if separator == " ":
        line = line.replace("\t", " ")
    reader = csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True)
    return [field.strip() for field in next(reader)]


def _decimal(path: Path, rows: list[list[str]], lines: list[int]) -> str:
    """The decimal mark. Raises InputError where commas could also group thousands."""
    first = None
    for number, row in zip(lines, rows, strict=True):
        for field in row:
            if _COMMA_NUMBER.fullmatch(field):
                if not _THOUSANDS.fullmatch(field):
                    return ","
                first = first or (number, field)
    if first is not None:
        what = f"the comma in {first[1]!r} may be a decimal mark or group thousands"
        remedy = "export with decimal points, or with more decimals"
        raise InputError(path, f"line {first[0]}", what, remedy)
    return "."
