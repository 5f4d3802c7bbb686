"""What a first cell says: the arm that was found, what was chosen, and what comes next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from studies.document import Document, Lines, Part, Section, Sentence, labelled
from studies.init.record import InitRecord


def told(record: InitRecord) -> Document:
    """The arm, the guesses and the next command."""
    return Document((), (Section("init", "A first cell", tuple(_parts(record))),))


def _parts(record: InitRecord) -> Iterator[Part]:
    robot, joints = record.robot, record.joints
    held = f"; held at zero: {', '.join(record.held)}" if record.held else ""
    yield Sentence(
        f"{record.name or robot.form}: {len(joints)} joints from {robot.base} to {robot.tip}: "
        f"{', '.join(joints)}{held}"
    )
    yield Sentence(
        "edit the lines marked EDIT: rough marker positions, the instrument's noise, and the arm's "
        "repeatability if you know it"
    )
    yield from labelled("note", record.notes)
    plan = Path(record.cell).parent / "plan.csv"
    yield Lines(f"then  posecal design {record.cell} -o {plan}")
