"""Signs that work goes on: on a terminal, and nowhere else."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from studies import cli
from studies.cli import run
from studies.command.call import _duration, working
from tests.helpers import measured_cell

RUN = "from studies.cli import run; run()"
CONTROL = re.compile(rb"\x1b\[[0-9;?]*[a-zA-Z]|\r")


def heard(folder: Path, *arguments: str) -> tuple[str, str]:
    """What a command says on a pseudo-terminal of 100 columns as standard error, and on a pipe."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, *arguments],
            cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=theirs,
        )  # fmt: skip
        os.close(theirs)
        said = b""
        while chunk := _read(terminal.fileno()):
            said += chunk
        out, _ = process.communicate()
    assert not process.returncode, said
    return CONTROL.sub(b"", said).decode(), out.decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # Linux: the other end was closed
        return b""


def test_a_terminal_sees_what_is_being_done_and_a_pipe_nothing(tmp_path: Path) -> None:
    measured_cell(tmp_path)
    terminal, out = heard(tmp_path, "identify", "cell.toml", "measurements.csv")
    for part in ("reading measurements.csv", "identifying"):
        assert part in terminal
        assert part not in out
    assert "0:00:0" in terminal  # how long it takes by now
    done = subprocess.run(
        [sys.executable, "-c", RUN, "identify", "cell.toml", "measurements.csv"],
        cwd=tmp_path, capture_output=True, check=True,
    )  # fmt: skip
    assert not done.stderr
    assert done.stdout.decode() == out
    assert "\x1b" not in out


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
