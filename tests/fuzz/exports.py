"""Exports of instruments and controllers: options, points and joints in one input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.files.columns import ANGLES, LENGTHS
from calib.files.csv_table import csv_text
from calib.files.exports import read_joints, read_points
from calib.files.exports.join import join
from studies.demo.embedded import embedded_cell
from studies.document.terminal import terminal
from studies.imports.command import _columns
from studies.imports.record import import_record, read_back
from studies.kinds import tell
from studies.record import envelope
from tests.fuzz.reader import PART, parts, put

CELL = embedded_cell()


def _options(text: bytes) -> dict[str, str]:
    """``names={pose}::{marker}|unit=mm|partial`` as options and their texts."""
    named = text.decode("utf-8", "surrogateescape").replace("\0", "").split("|")
    return {option: value for option, _, value in (entry.partition("=") for entry in named)}


def _joint_options(given: dict[str, str]) -> dict[str, Any]:
    unit, names = given.get("unit_joints"), given.get("joint_names")
    return {
        "unit": unit if unit in (*ANGLES, *LENGTHS) else None,
        "rename": None if names is None else [name.strip() for name in names.split(",")],
        "robot": CELL.robot if "cell" in given else None,
    }


def points(folder: Path, content: bytes) -> object:
    """All that ``posecal import`` does between its options and its output."""
    head, text, table = parts(content, 3)
    given = _options(head)
    unit = given.get("unit")
    own = read_points(
        put(folder, "day.txt", text),
        unit if unit in ("mm", "m", "in") else None,
        _columns(given.get("columns")),
    )
    joints = read_joints(put(folder, "joints.csv", table), **_joint_options(given))
    joined = join(
        [own],
        joints,
        names=given.get("names"),
        marker=given.get("marker"),
        by_order="by_order" in given,
        partial="partial" in given,
        markers=CELL.marker_names if "cell" in given else None,
    )
    out = csv_text(joined.columns, joined.rows)
    notes = read_back(CELL, out, folder / "out.csv", False) if "cell" in given else ()
    record = import_record([own], joints, joined, notes, envelope("", []))
    return record.dumps(), [*terminal(tell(record))]


def joints(folder: Path, content: bytes) -> object:
    head, table = parts(content, 2)
    return read_joints(put(folder, "joints.csv", table), **_joint_options(_options(head)))


def _input(*texts: str) -> str:
    return PART.join(texts)


_AXES = "A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg"
_TABLE = f"pose,{_AXES},fx_N,station\np1,1,-90,80,5,-30,0,0,s\np2,-20,-45,100,15,30,90,-5,s\n"
_BLANKS = "name A1 A2 A3 A4 A5 A6\np1 1,5 -90,0 80,25 5 -30,5 0\np2 -20 -45 100,5 15 30 90\n"
_DAY = "// Units: mm\r\nA, p1, m1, 1.5, 2.25, 3\r\nA, p1, m2, 4, 5, 6\r\nA, p2, m1, 7, 8, 9.5\r\n"
_NAMED = (
    "Point Name;X [m];Y [m];Z [m];Ux;Uy;Uz;Time\n"
    "p1_m1;1,5;0,25;3,125;0,01;0,02;0,03;2026-01-02T10:00:00\n"
    "p2_m1;1,5;0,75;2,5;0,01;0,02;0,03;2026-01-02T10:01:30+00:00\n"
)
_BARE = "m1\t1.5\t2.5\t3.5\nm2\t1\t2\t3\nm1\t4\t5\t6\nm2\t7\t8\t9\n"

POINTS = (
    _input("cell|partial", _DAY, _TABLE),
    _input("names={pose}_{marker}|unit_joints=deg", _NAMED, _BLANKS),
    _input("names={marker}|by_order|unit=in|columns=point,x,y,z", _BARE, _TABLE),
    _input("names={pose}|marker=m1|unit=mm", "p1 1 2 3\np2 4 5 6\n", _TABLE),
    _input(
        "names={pose}::*{marker}|by_order|unit=m",
        _DAY.replace("// Units: mm", "# day"),
        "A1_deg\n1\n2\n",
    ),
)
_KRL = (
    "P001 {A1 1.5, A2 -90.0, A3 80, A4 5, A5 -30, A6 0}\n"
    "P002 {A1 2, A2 0, A3 0, A4 1, A5 1, A6 1e1}\n"
)
_DECLARED = "DECL E6AXIS XP1={A1 1.0,A2 -90.0,A3 90,A4 0,A5 0,A6 0,E1 0.5,E2 0}\n"
JOINTS = (
    _input("cell", _TABLE),
    _input("unit_joints=rad|joint_names=A1,A2,A3,A4,A5,A6", _BLANKS),
    _input("", _KRL),
    _input("unit_joints=mm", _DECLARED),
    _input("cell", _TABLE.replace("_deg", " [°]").replace(",", ";").replace("0;", "0,5;")),
)
