"""Hostile names, odd encodings, a terminal that goes away, and signs there that work goes on."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
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


def edited(path: Path, *changes: tuple[str, str]) -> None:
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A cell with markup, mathematics and paths for names."""
    folder = tmp_path / "deep" / "cell"
    folder.mkdir(parents=True)
    put_small_cell(folder)
    limits = f"[robot.limits_deg]\n'{JOINT}' = [-110, 110]\n[markers_mm]"
    edited(
        folder / "cell.toml", ("m1 =", f"'{MARKER}' ="), ('"small"', f'"{NAME}"'),
        ("[markers_mm]", limits), ('"joint_offset"', f"'transmission_scale:{JOINT}'"),
    )  # fmt: skip
    xml = JOINT.replace("<", "&lt;").replace(">", "&gt;")
    edited(folder / "arm.urdf", ('name="A2"', f'name="{xml}"'))
    for name in ("data.csv", "plan.csv", "targets.csv"):
        edited(folder / name, ("A2_deg", f"{JOINT}_deg"), ("\np", "\n../../p"))
    edited(folder / "data.csv", (",m1,", f",{MARKER},"))
    return folder


def test_names_are_printed_as_they_are_and_name_no_files(
    hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outside() -> set[Path]:
        return {p for p in tmp_path.rglob("*") if hostile not in p.parents}

    before = outside()
    monkeypatch.chdir(hostile)
    written = ("--figures", "figures", "--json", "out.json", "--urdf", "out.urdf")
    heard = posecal("identify", "cell.toml", "data.csv", *written)
    assert not heard.status, heard.err
    assert heard.out.startswith(f"{NAME}: The error at ")
    assert JOINT in heard.out
    found = json.loads(Path("out.json").read_text())
    assert f"tool:marker:{MARKER}.x" in {p["id"] for p in found["parameters"]}
    assert all(r["pose"].startswith("../../p") for r in found["residuals"])
    for picture in Path("figures").glob("*.svg"):
        ElementTree.parse(picture)
    assert outside() == before
    edited(Path("cell.toml"), ("arm.urdf", "out.urdf"))
    assert not posecal("identify", "cell.toml", "data.csv").status


ENCODED: dict[str, Callable[[str], bytes]] = {
    "byte order mark": lambda text: text.encode("utf-8-sig"),
    "line ends of Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "line ends of old": lambda text: text.replace("\n", "\r").encode(),
    "names beyond ASCII": lambda text: text.replace("p1", "M\u00fcller \u673a").encode(),
    "no last line end": lambda text: text.rstrip("\n").encode(),
    "UTF-16": lambda text: text.encode("utf-16"),
    "Latin-1": lambda text: text.replace("p1", "M\u00fcller").encode("latin-1"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("how", ENCODED)
def test_encodings(small: Path, how: str) -> None:
    call = ("identify", str(small / "cell.toml"), str(small / "data.csv"))
    expected = posecal(*call).out
    (small / "data.csv").write_bytes(ENCODED[how]((small / "data.csv").read_text()))
    heard = posecal(*call)
    if how in ("UTF-16", "Latin-1"):
        assert heard.status == 2
        assert heard.err.endswith("data.csv: is not text in UTF-8; export it as CSV\n")
    else:
        assert not heard.status, heard.err
        assert heard.out == expected


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
    small: Path,
) -> None:
    edited(small / "cell.toml", ('"small"', '"M\u00fcller"'))
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        out, _, status = ended(small, *IDENTIFY, stderr=theirs, env=environment)
        os.close(theirs)
        seen = CONTROL.sub(b"", drained(terminal.fileno())).decode()
    assert status == 0, seen
    for part in ("reading data.csv", "identifying"):
        assert part in seen
        assert part not in out
    assert "0:00:0" in seen  # how long it takes by now
    assert out.startswith("M\u00fcller: The error at")
    ascii_out, err, _ = ended(small, *IDENTIFY, env=environment | {"PYTHONIOENCODING": "ascii"})
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


class _Terminal(io.StringIO):
    """Standard error that says it is one."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("seconds", "said"), [(2.0, ""), (42.0, "about 42 s"), (300.0, "about 5 min")]
)
def test_long_work_is_forecast(seconds: float, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = _Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    with working("identifying", seconds) as done:
        done(1)
    assert "identifying" in terminal.getvalue()
    assert ("about" in terminal.getvalue()) == bool(said)
    assert said in terminal.getvalue()


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
