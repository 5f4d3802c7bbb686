"""What ``posecal demo`` did, how it is told, and what to try next."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from studies.document import WHOLE, Detail, Document, Lines, Section, Shown, Table, columns
from studies.record import Entry, InputFile, NotNegative, Record


class DemoStep(Entry):
    """A step, what it found, and how long it took."""

    step: str
    says: Annotated[str, Shown("found")]
    seconds: Annotated[NotNegative, Shown("time", WHOLE, unit="s")]


class DemoRecord(Record):
    """A demonstration.

    folder : where it is; withheld : the error that was hidden
    files : what it wrote there, by name and content
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["demo"] = "demo"
    folder: str
    withheld: str
    steps: tuple[DemoStep, ...]
    files: tuple[InputFile, ...]


def told(record: DemoRecord) -> Document:
    """The steps, which the terminal saw as they were done, and the next ones."""
    steps = Detail((Table(_STEPS, record.steps, "Steps", fold=False),))
    parts = (steps, Lines(_next_steps(record.folder)))
    return Document((), (Section("demo", "The whole way", parts),))


_STEPS = columns(DemoStep, "step says seconds")


def _next_steps(folder: str) -> str:
    return f"""\
In {folder}: the inputs cell.toml, kr270.urdf, table2.csv (the paper's plan), plan.csv,
measurements.csv and check.csv; the truth, which nothing else reads, in truth.json; what each command
printed and found in its .txt and .json; kr270_calibrated.urdf, better_cell.toml and report.html.

Try next:
  posecal identify {folder}/better_cell.toml {folder}/measurements.csv --holdout {folder}/check.csv
  posecal compensate {folder}/cell.toml {folder}/diagnose.json {folder}/table2.csv -o corrected.csv
  posecal program {folder}/cell.toml {folder}/plan.csv -o {folder}/plan.src"""
