"""What a reader is to the fuzzer, and its rule: what it cannot use ends in one plain line, at once."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.errors import CalibError
from studies.demo.embedded import INPUTS, embedded_text
from tests.fuzz.mutate import mutated

Read = Callable[[Path, bytes], object]
PART = "\n#----\n"
"""Between the files of an input that holds several."""


@dataclass(frozen=True)
class Reader:
    """What reads the bytes, and inputs to start from.

    given : the inputs, or what makes them where that takes its time
    seconds : one input may take no longer
    """

    read: Read
    given: tuple[str, ...] | Callable[[], tuple[str, ...]]
    seconds: int = 5

    @cached_property
    def seeds(self) -> tuple[str, ...]:
        """Inputs that the reader accepts."""
        return self.given if isinstance(self.given, tuple) else self.given()


def put(folder: Path, name: str, content: bytes) -> Path:
    """The file with the content."""
    path = folder / name
    path.write_bytes(content)
    return path


def parts(content: bytes, count: int) -> list[bytes]:
    """The files of an input, empty where one is missing."""
    found = content.split(PART.encode(), count - 1)
    return found + [b""] * (count - len(found))


def neighbour(reader: Reader, text: str, rng: random.Random) -> str:
    """A change of an input, as its kind asks for."""
    return mutated(text, reader.seeds, rng)


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
