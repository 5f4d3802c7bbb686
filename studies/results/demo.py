"""The JSON of ``posecal demo``."""

from __future__ import annotations

from typing import ClassVar, Literal

from studies.results.base import Entry, InputFile, NotNegative, Result


class DemoStep(Entry):
    """A step, what it says, and how long it took."""

    step: str
    says: str
    seconds: NotNegative


class DemoResult(Result):
    """A demonstration in a folder.

    withheld : the error that was hidden; files : what it wrote, by name and content
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["demo"] = "demo"
    folder: str
    withheld: str
    steps: tuple[DemoStep, ...]
    files: tuple[InputFile, ...]
