"""Hostile names, odd encodings, a terminal that goes away, and signs there that work goes on."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from studies import cli
from studies.cli import run
from studies.command.call import _duration, working
from tests.bad_inputs.run import posecal
from tests.fuzz.small_cell import put_small_cell

JOINT = r"[/]$\frac$<b>:smile:"
MARKER = r"[bold red]../../m1[/bold]$\x$"
NAME = r"[/]cell & ${x}"


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
    assert not heard.status, heard.err
    assert heard.out.startswith(f"{NAME}: The error at ")
    assert JOINT in heard.out
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


CONTROL = re.compile(rb"\x1b\[[0-9;?]*[a-zA-Z]|\r")

CALL = [sys.executable, "-c", "from studies.cli import run; run()"]
IDENTIFY = ("identify", "cell.toml", "data.csv")


def ended(folder: Path, *words: str, **options: Any) -> tuple[str, str, int]:
    """What a process of its own says on standard output and error, and its status."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    with subprocess.Popen([*CALL, *words], cwd=folder, text=True, **options) as process:
        out, err = process.communicate()
    return out, err, process.returncode


def test_a_reader_that_goes_away(tmp_path: Path) -> None:
    """As ``posecal explain .. | head -1``."""
    reading, writing = os.pipe()
    os.close(reading)
    _, err, status = ended(tmp_path, "explain", "cell", stdout=writing)
    os.close(writing)
    assert err == ""
    assert status != 0


def test_a_full_standard_output(tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        _, err, status = ended(tmp_path, "identify", "--help", stdout=full)
    assert err == "posecal: standard output cannot be written (No space left on device)\n"
    assert status == 2


def test_a_terminal_sees_what_is_being_done_and_a_pipe_of_few_characters_nothing(
    tmp_path: Path,
) -> None:
    put_small_cell(tmp_path)
    cell = (tmp_path / "cell.toml").read_text().replace('"small"', '"M\u00fcller"')
    (tmp_path / "cell.toml").write_text(cell, encoding="utf-8")
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        out, _, status = ended(tmp_path, *IDENTIFY, stderr=theirs, env=environment)
        os.close(theirs)
        seen = CONTROL.sub(b"", drained(terminal.fileno())).decode()
    assert status == 0, seen
    for part in ("reading data.csv", "identifying"):
        assert part in seen
        assert part not in out
    assert "0:00:0" in seen  # how long it takes by now
    assert out.startswith("M\u00fcller: The error at")
    ascii_out, err, _ = ended(tmp_path, *IDENTIFY, env=environment | {"PYTHONIOENCODING": "ascii"})
    assert all(line.startswith("warning: data.csv: ") for line in err.splitlines())
    assert ascii_out.startswith("M\\xfcller: The error at")
    assert "\x1b" not in out


def drained(terminal: int) -> bytes:
    """All that a pseudo-terminal holds once its other end is closed."""
    said = b""
    with contextlib.suppress(OSError):  # how Linux says that the other end was closed
        while chunk := os.read(terminal, 65536):
            said += chunk
    return said


class _Terminal:
    """Standard error that says it is one."""

    def __init__(self) -> None:
        self.said = ""

    def write(self, text: str) -> int:
        self.said += text
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("seconds", "said"), [(2.0, None), (42.0, "about 42 s"), (300.0, "about 5 min")]
)
def test_long_work_is_forecast(
    seconds: float, said: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = _Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    with working("identifying", seconds) as done:
        done(1)
    assert "identifying" in terminal.said
    assert ("about" in terminal.said) == (said is not None)
    assert said is None or said in terminal.said


def test_durations_have_one_figure() -> None:
    assert (_duration(89.0), _duration(120.0)) == ("89 s", "2 min")


def test_where_memory_ends_one_line_says_what_needs_less(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def exhausted(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(cli, "main", exhausted)
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("posecal: out of memory; take fewer readings")
    assert said.count("\n") == 1
