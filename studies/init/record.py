"""What ``posecal init`` made of a robot's file, and how it is told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from calib.arm.robot import Form
from studies.document import Document, Lines, Part, Section, Sentence, labelled
from studies.record import Entry, Envelope, Record

if TYPE_CHECKING:
    from calib.files.proposal import Proposal


class Proposed(Entry):
    """The arm as found."""

    form: Form
    base: str
    tip: str


class InitRecord(Record):
    """A first cell for a robot.

    cell, table : the files that were written; name : of the arm
    held : joints of the file that are not of the chain, at zero
    others : tips beside that of ``robot``
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["init"] = "init"
    table: str
    name: str
    robot: Proposed
    joints: tuple[str, ...] = Field(min_length=1)
    held: tuple[str, ...]
    others: tuple[str, ...]
    notes: tuple[str, ...]


def init_record(found: Proposal, name: str, table: Path, made_from: Envelope) -> InitRecord:
    """The record of a proposal."""
    arm = Proposed.from_result(found, found.robot)
    own = {"warnings": found.lacks, "table": table, "name": name, "robot": arm}
    return InitRecord.from_result(found, found.robot, **made_from, **own)


def told(record: InitRecord) -> Document:
    """The arm, the guesses and the next command."""
    return Document((), (Section("init", "A first cell", tuple(_parts(record))),))


def _parts(record: InitRecord) -> Iterator[Part]:
    robot, joints = record.robot, record.joints
    tips = " and ".join((robot.tip, *record.others))
    held = f"; held at zero: {', '.join(record.held)}" if record.held else ""
    yield Sentence(
        f"{record.name or robot.form}: {len(joints)} joints from {robot.base} to {tips}: "
        f"{', '.join(joints)}{held}"
    )
    yield Sentence(
        "edit the lines marked EDIT: rough marker positions, the instrument's noise, and the arm's "
        "repeatability if you know it"
    )
    yield from labelled("note", record.notes)
    plan = Path(record.cell).parent / "plan.csv"
    yield Lines(f"then  posecal design {record.cell} -o {plan}")
