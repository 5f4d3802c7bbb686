"""What ``posecal demo`` did."""

from __future__ import annotations

from typing import ClassVar, Literal

from studies.record import Entry, InputFile, NotNegative, Record


class Step(Entry):
    """A step, what it found, and how long it took."""

    step: str
    says: str
    seconds: NotNegative


class DemoRecord(Record):
    """A demonstration.

    folder : where it is, "." in results of earlier versions; withheld : the error that was hidden
    files : what it wrote there, by name and content
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["demo"] = "demo"
    folder: str = "."
    withheld: str
    steps: tuple[Step, ...]
    files: tuple[InputFile, ...]
