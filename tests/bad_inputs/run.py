"""Do what a user did wrong, and hear what is said."""

from __future__ import annotations

import csv
import re
import shlex
import shutil
import tempfile
from pathlib import Path

from tests.bad_inputs.faults import FAULTS, Fault
from tests.helpers import measured_cell
from tests.studies.command_line import Heard, heard


def posecal(*words: str) -> Heard:
    """The command line here."""
    return heard(shlex.join(words), Path())


def prepare(folder: Path) -> None:
    """A cell, a plan, measurements and results, points and joints apart, and an empty folder."""
    folder.mkdir(exist_ok=True)
    measured_cell(folder)
    said = heard("identify cell.toml measurements.csv --json result.json", folder)
    assert not said.status, said.err
    (folder / "figures").mkdir()
    header, *rows = csv.reader((folder / "measurements.csv").read_text().splitlines())
    x = header.index("x_mm")
    points = [",".join([*row[:2], *row[x : x + 3]]) for row in rows]
    joints = dict.fromkeys(",".join([row[0], *row[2:x]]) for row in rows)
    titles = ",".join(["pose", *header[2:x]])
    (folder / "points.csv").write_text("\n".join(["pose,marker,x_mm,y_mm,z_mm", *points, ""]))
    (folder / "joints.csv").write_text("\n".join([titles, *joints, ""]))
    (folder / "aims.csv").write_text((folder / "plan.csv").read_text())


def committed(fault: Fault, good: Path, folder: Path) -> Heard:
    """The call of a fault, in a fresh copy of good files."""
    shutil.copytree(good, folder)
    if fault.file:
        path = folder / fault.file
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        path.write_text(fault.edit(text), encoding="utf-8")
        if fault.file == "targets.csv":
            cell = folder / "cell.toml"
            cell.write_text(cell.read_text().replace('# targets = "', 'targets = "'))
    return heard(fault.call, folder)


def listed() -> str:
    """Every fault with the line that the user sees, as Markdown tables."""
    text = f"""# Bad inputs

{sum(map(len, FAULTS.values()))} things that users do wrong on a cell, a plan and measurements, and the
line that `posecal` says to each before it ends with status 2. Made by `python -m tests.bad_inputs`.
"""
    with tempfile.TemporaryDirectory() as folder:
        good = Path(folder) / "good"
        prepare(good)
        for section, faults in FAULTS.items():
            text += f"\n## {section}\n\n| wrong | call | said |\n|---|---|---|\n"
            for fault in faults:
                with tempfile.TemporaryDirectory(dir=folder) as own:
                    said = committed(fault, good, Path(own) / "cell")
                text += row(fault, said.err.strip())
    return text


def row(fault: Fault, said: str) -> str:
    """A line of the list, without the words of other libraries, which change with their versions."""
    for words, ours in _FOREIGN:
        said = re.sub(words, ours, said)
    cells = (fault.did, f"`posecal {fault.call}`", f"`{said}`")
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |\n"


_FOREIGN = (
    (r"(is not valid TOML: ).*", r"\1..."),
    (r"(is not well-formed XML \().*(\); export)", r"\1...\2"),
    (r"(is no CSV \().*(\); check)", r"\1...\2"),
    (r"(is refused by MuJoCo: )[^']*('[\w.]+')[^;]*; Element '\w+'", r"\1... \2 ..."),
    (r"(Invalid value for '[\w-]+'): .*(; see)", r"\1: ...\2"),
    (r"(No such (?:option|command)).*(; see)", r"\1 ...\2"),
)
