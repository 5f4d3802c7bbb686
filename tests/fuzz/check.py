"""The rule for every reader: what it cannot use ends in one plain line, at once."""

from __future__ import annotations

import warnings
from pathlib import Path

from calib.errors import CalibError
from studies.demo.embedded import INPUTS, embedded_text
from tests.fuzz.reader import Reader

LONGEST = 1010  # characters of a message


class Unreadable(AssertionError):
    """A message that is no plain line."""


def prepared(folder: Path) -> Path:
    """The folder with the files that cells name."""
    for name in INPUTS:
        (folder / name).write_text(embedded_text(name), encoding="utf-8")
    (folder / "targets.csv").write_text(embedded_text("plan.csv"), encoding="utf-8")
    return folder


def broken_rule(reader: Reader, folder: Path, content: bytes) -> BaseException | None:
    """What a reader raises beyond CalibError; None where it keeps the rule."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(folder, content)
    except CalibError as error:
        text = str(error)
        if not text.isprintable() or len(text) > LONGEST:
            return Unreadable(ascii(text[:200])).with_traceback(error.__traceback__)
    except Exception as error:
        return error
    return None
