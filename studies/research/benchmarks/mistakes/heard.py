"""What the command line says to a call, in this process."""

from __future__ import annotations

import contextlib
import io
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from studies.cli import run

_TRACEBACK = 1  # the status with which Python ends then


@dataclass(frozen=True)
class Heard:
    """How a call ended: its status, and what it wrote."""

    status: int
    out: str
    err: str

    @property
    def text(self) -> str:
        """All that was written, in one line."""
        return " ".join(f"{self.err} {self.out}".split())


def heard(call: str, folder: Path) -> Heard:
    """A call of posecal in a folder."""
    out, err = io.StringIO(), io.StringIO()
    words = ["posecal", *shlex.split(call)]
    with (
        contextlib.chdir(folder),
        mock.patch.object(sys, "argv", words),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            run()
            status: object = 0
        except SystemExit as end:
            status = end.code
        except Exception as error:
            status = _TRACEBACK
            err.write(f"traceback: {type(error).__name__}: {error}")
    return Heard(status if isinstance(status, int) else 0, out.getvalue(), err.getvalue())
