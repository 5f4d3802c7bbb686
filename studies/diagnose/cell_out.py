"""The cell with what a diagnosis found, and what is said about it."""

from __future__ import annotations

from pathlib import Path

from calib import Cell
from calib.diagnosis import Diagnosis
from calib.files.cell_out import extended_cell


def better_cell(cell: Cell, result: Diagnosis, target: Path) -> tuple[str, list[str]]:
    """The text of the cell for a target file, and a line for everything the reader must know.

    Raises InputError where the cell file cannot be read any more.
    """
    found = [cause.named.candidate.effect for cause in result.causes]
    made = extended_cell(cell, found, result.data.poses, target)
    notes = [
        f"{target}: model with {', '.join(made.added)}"
        if made.added
        else f"{target}: the model as it was; no effect was found that could be added"
    ]
    if made.replaced:
        notes.append(f"{target}: they contain, and replace, {', '.join(made.replaced)}")
    notes += [f"{target}: without {effect}; {reason}" for effect, reason in made.refused]
    for cause in result.causes:
        alike = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members[1:]]
        if alike:
            first = cause.named.candidate
            notes.append(
                f"{target}: {first.effect.kind}:{first.where} stands for {' or '.join(alike)} too, "
                "which these data cannot tell from it"
            )
    unnamed = [
        f"{entry.candidate.where} by {entry.candidate.depends_on}"
        for entry in result.outcome.entries
        if not entry.candidate.named
    ]
    if unnamed:
        notes.append(f"{target}: without {', '.join(unnamed)}; a curve without a name is no effect")
    return made.text, notes
