"""From a session to the record of its identification."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from studies.command.options import faults_in
from studies.command.session import Session

if TYPE_CHECKING:
    from calib import Identification
    from calib.identification.identification import Method
    from calib.observations import Approach, Weighting
    from studies.identify.record import IdentifyRecord

MOST = 200_000
"""Readings of a table that are identified: they take 15 kB each."""
SECONDS = 0.8e-3
"""What each of them takes, s, as measured (``studies.research.benchmarks.readings``)."""


def inputs_of(session: Session) -> list[Path]:
    """What the record is made from, the cell first."""
    return [*session.read, *session.named, *session.held.files]


def identified(
    session: Session,
    *,
    approach: Approach = "points",
    method: Method = "joint",
    weighting: Weighting = "full",
    length_mm: float = 1000.0,
    differences: bool = False,
) -> tuple[Identification, IdentifyRecord]:
    """Identify a session.

    length_mm : characteristic length of the plain weighting

    Raises InputError naming the file that is at fault.
    """
    import calib
    from calib.compensation.estimate import estimate_of
    from calib.drift import drift_in
    from calib.poses.thinning import thinned
    from calib.uncertainty.acceptance import judged
    from calib.uncertainty.budget import accuracy_at_targets
    from studies.identify.record import Asked, identify_record
    from studies.record import envelope

    cell, held = session.cell, session.held
    data, said = thinned(held.data, MOST)
    with faults_in(session.data_path, effects_of=cell.path):
        found = calib.identify(
            cell, data, heldout=held.heldout, approach=approach, method=method,
            weighting=weighting, length=length_mm * 1e-3, differences=differences,
        )  # fmt: skip
    of_pose = approach == "pose"
    asked = Asked(
        weighting=weighting if of_pose else None,
        length_mm=length_mm if of_pose and weighting == "plain" else None,
        differences=differences,
        holdout=session.holdout,
    )
    estimate = estimate_of(found)
    record = identify_record(
        found,
        accuracy_at_targets(cell, found, estimate),
        drift_in(cell, found, session.whole),
        estimate,
        asked,
        envelope(cell.name, inputs_of(session), session.seed, cell.about),
        (*held.warnings, *said),
        judged(cell, found),
    )
    return found, record
