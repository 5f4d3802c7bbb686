"""Hostile names, odd encodings, and a terminal that goes away."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.bad_inputs.run import posecal, prepare

JOINT = r"[/]$\frac$<b>:smile:"
MARKER = r"[bold red]../../m1[/bold]$\x$"
NAME = r"[/]cell & ${x}"


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terminal") / "good"
    prepare(folder)
    return folder


@pytest.fixture
def hostile(good: Path, tmp_path: Path) -> Path:
    """The demonstration with markup, mathematics and paths for names."""
    folder = tmp_path / "deep" / "cell"
    folder.mkdir(parents=True)
    cell = (good / "cell.toml").read_text()
    cell = re.sub("^A2 =", lambda _: f"'{JOINT}' =", cell, flags=re.M).replace(
        ':A2"', f':{JOINT}"'.replace("\\", "\\\\")
    )
    cell = re.sub("^m1 =", lambda _: f"'{MARKER}' =", cell, flags=re.M)
    (folder / "cell.toml").write_text(
        cell.replace("{ A2 =", f"{{ '{JOINT}' =").replace("kr270 milling cell", NAME)
    )
    xml = JOINT.replace("<", "&lt;").replace(">", "&gt;")
    urdf = (good / "kr270.urdf").read_text()
    (folder / "kr270.urdf").write_text(urdf.replace('name="A2"', f'name="{xml}"'))
    for name in ("measurements.csv", "plan.csv"):
        table = (good / name).read_text().replace("A2_deg", JOINT + "_deg")
        table = table.replace(",m1,", f",{MARKER},").replace("\np0", "\n../../p0")
        (folder / name).write_text(table)
    return folder


def test_names_are_printed_as_they_are_and_name_no_files(hostile: Path) -> None:
    outside = {p for p in hostile.parents[1].rglob("*") if hostile not in p.parents}
    with contextlib.chdir(hostile):
        heard = posecal(
            "identify", "cell.toml", "measurements.csv",
            "--figures", "figures", "--json", "out.json", "--urdf", "out.urdf",
        )  # fmt: skip
        planned = posecal("compare", "cell.toml", "plan.csv", "--monte-carlo", "0")
    for said, begins in ((heard, "The error at"), (planned, "plan.csv: expected error")):
        assert not said.status, said.err
        assert said.out.startswith(f"{NAME}: {begins} ")
        assert JOINT in said.out
    found = json.loads((hostile / "out.json").read_text())
    assert f"tool:marker:{MARKER}.x" in {p["id"] for p in found["parameters"]}
    assert any(r["pose"].startswith("../../p0") for r in found["residuals"])
    for picture in (hostile / "figures").glob("*.svg"):
        ElementTree.parse(picture)
    assert {p for p in hostile.parents[1].rglob("*") if hostile not in p.parents} == outside
    again = (hostile / "cell.toml").read_text().replace("kr270.urdf", "out.urdf")
    (hostile / "again.toml").write_text(again)
    with contextlib.chdir(hostile):
        assert not posecal("identify", "again.toml", "measurements.csv").status


@pytest.fixture(scope="module")
def expected(good: Path) -> str:
    """What is printed for the table as it was."""
    return posecal("identify", str(good / "cell.toml"), str(good / "measurements.csv")).out


def encoded(text: str, how: str) -> bytes:
    ways = {
        "byte order mark": lambda: text.encode("utf-8-sig"),
        "line ends of Windows": lambda: text.replace("\n", "\r\n").encode(),
        "line ends of old": lambda: text.replace("\n", "\r").encode(),
        "UTF-16": lambda: text.encode("utf-16"),
        "Latin-1": lambda: text.replace("p01", "M\u00fcller").encode("latin-1"),
        "names beyond ASCII": lambda: text.replace("p01", "M\u00fcller \u673a").encode(),
        "no last line end": lambda: text.rstrip("\n").encode(),
    }
    return ways[how]()


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("how", "readable"),
    [
        ("byte order mark", True),
        ("line ends of Windows", True),
        ("line ends of old", True),
        ("names beyond ASCII", True),
        ("no last line end", True),
        ("UTF-16", False),
        ("Latin-1", False),
    ],
)
def test_encodings(good: Path, expected: str, tmp_path: Path, how: str, readable: bool) -> None:
    table = (good / "measurements.csv").read_text()
    (tmp_path / "data.csv").write_bytes(encoded(table, how))
    heard = posecal("identify", str(good / "cell.toml"), str(tmp_path / "data.csv"))
    if readable:
        assert not heard.status, heard.err
        assert heard.out == expected
    else:
        assert heard.status == 2
        assert heard.err.endswith("data.csv: is not text in UTF-8; export it as CSV\n")


def command(folder: Path, *words: str, **options: object) -> subprocess.Popen[str]:
    call = [sys.executable, "-c", "from studies.cli import run; run()", *words]
    return subprocess.Popen(  # type: ignore[call-overload]
        call, cwd=folder, stderr=subprocess.PIPE, text=True, **options
    )


IDENTIFY = ("identify", "cell.toml", "measurements.csv")


def test_a_reader_that_goes_away(good: Path) -> None:
    """As ``posecal explain .. | head -1``."""
    reading, writing = os.pipe()
    os.close(reading)
    process = command(good, "explain", "cell", stdout=writing)
    os.close(writing)
    assert process.communicate()[1] == ""
    assert process.returncode != 0


def test_a_full_standard_output(good: Path) -> None:
    with open("/dev/full", "w") as full:
        process = command(good, "identify", "--help", stdout=full)
    said = process.communicate()[1]
    assert said == "posecal: standard output cannot be written (No space left on device)\n"
    assert process.returncode == 2


def test_a_terminal_of_few_characters(good: Path, tmp_path: Path) -> None:
    for name in ("cell.toml", "kr270.urdf"):
        text = (good / name).read_text().replace("kr270 milling cell", "M\u00fcller")
        (tmp_path / name).write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    words = (*IDENTIFY[:2], str(good / IDENTIFY[2]))
    out, err = command(tmp_path, *words, env=environment, stdout=subprocess.PIPE).communicate()
    assert err == ""
    assert out.startswith("M\\xfcller: The error at the fitted poses fell")
