"""From a session to the record of its diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from studies.command.options import faults_in
from studies.command.session import Session

if TYPE_CHECKING:
    from calib import Cell
    from calib.diagnosis import Diagnosis
    from doe.ahead.next_poses import NextPoses
    from studies.diagnose.record import DiagnoseRecord

NEXT = 8
"""Poses that are proposed where rivals are left."""
MOST = 4000
"""Readings of a table that are diagnosed: every candidate at each of them takes a megabyte."""
SECONDS = 10e-3
"""What each of them takes, s, as measured (``studies.research.benchmarks.readings``)."""


def inputs_of(session: Session) -> list[Path]:
    """What the record is made from, the cell first."""
    prior = session.cell.prior_file
    return [*session.read, *session.held.files, *([prior] if prior else [])]


def diagnosed(
    session: Session, next_count: int = NEXT, *, figures: bool = True
) -> tuple[Diagnosis, DiagnoseRecord]:
    """Diagnose a session.

    next_count : poses to propose; figures : whether the record holds what they show

    Raises InputError naming the file that is at fault.
    """
    from calib.diagnosis.diagnose import diagnose
    from calib.diagnosis.spectra import spectra
    from calib.poses.thinning import thinned
    from studies.diagnose.record import diagnose_record
    from studies.diagnose.shown import shown
    from studies.record import envelope

    cell, held = session.cell, session.held
    data, said = thinned(held.data, MOST)
    with faults_in(session.data_path, effects_of=cell.path):
        found = diagnose(cell, data, heldout=held.heldout)
    chosen, failed = _next(cell, found, next_count, session.seed)
    record = diagnose_record(
        found,
        spectra(found),
        chosen,
        shown(found) if figures else None,
        session.holdout,
        envelope(cell.name, inputs_of(session), session.seed, cell.about),
        (*held.warnings, *said, *failed),
    )
    return found, record


def _next(
    cell: Cell, found: Diagnosis, count: int, seed: int
) -> tuple[NextPoses | None, tuple[str, ...]]:
    """Poses that tell rivals apart, and why there are none: the diagnosis stands without them."""
    from calib.errors import CalibError
    from doe.ahead.next_poses import next_poses

    try:
        return (next_poses(cell, found, count=count, seed=seed) if count else None), ()
    except CalibError as error:
        return None, (f"no next poses: {error}",)
