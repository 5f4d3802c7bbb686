"""What a reader is to the fuzzer."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

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
