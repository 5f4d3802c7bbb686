"""The command line in this process, and what it said."""

from __future__ import annotations

import contextlib
import io
import shlex
import sys
from pathlib import Path
from typing import NamedTuple
from unittest import mock

from studies.cli import run


class Heard(NamedTuple):
    """How a call ended: its status, and what it wrote to both streams."""

    status: int
    out: str
    err: str


def heard(call: str, folder: Path) -> Heard:
    """Words after ``posecal``, said in a folder."""
    out, err, status = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.chdir(folder),
        mock.patch.object(sys, "argv", ["posecal", *shlex.split(call)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            run()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0
        except Exception as error:
            status = 1  # with which Python ends then
            err.write(f"traceback: {type(error).__name__}: {error}")
    return Heard(status, out.getvalue(), err.getvalue())
