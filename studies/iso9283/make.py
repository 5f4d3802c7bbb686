"""From a table and a result to the criteria."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from studies.record import Envelope

if TYPE_CHECKING:
    from calib import Cell, Measurements
    from calib.arrays import IntArray
    from calib.compensation.estimate import Estimate
    from calib.iso9283 import Measured, Session
    from studies.iso9283.record import Iso9283Record


class _Known(NamedTuple):
    """An estimate, degrees of freedom behind it, and whether it was fitted to the table in hand."""

    estimate: Estimate
    freedom: float
    same_data: bool


def criteria(
    cell: Cell,
    data: Measurements,
    data_path: Path,
    result_path: Path | None,
    marker: str | None,
    made_from: Envelope,
) -> Iso9283Record:
    """The record of a table by a result, or by an identification of the table itself.

    Raises InputError, CalibError.
    """
    from calib.iso9283 import session_of
    from calib.iso9283.formulas import repeatability_of
    from calib.iso9283.measured import measured
    from calib.iso9283.predicted import predicted
    from studies.iso9283.record import iso9283_record

    known = _fitted(cell, data) if result_path is None else _read(cell, data_path, result_path)
    session = session_of(known.estimate, data, marker)
    found = measured(session)
    expected = predicted(cell, session, _once(session, found), known.freedom)
    noise = np.eye(3) * session.sigma**2
    return iso9283_record(
        session.model.marker_names[session.marker],
        found,
        expected,
        known.same_data,
        repeatability_of(noise),
        made_from,
        (*data.warnings, *known.estimate.notes),
    )


def _fitted(cell: Cell, data: Measurements) -> _Known:
    import calib
    from calib.compensation.estimate import estimate_of

    found = calib.identify(cell, data)
    return _Known(estimate_of(found), found.freedom, True)


def _read(cell: Cell, data_path: Path, path: Path) -> _Known:
    from calib.errors import InputError
    from calib.files.estimate import load_estimate
    from calib.files.read import sha256
    from studies.identify.record import IdentifyRecord
    from studies.results import read

    record, estimate = read(path), load_estimate(cell, path)
    if not estimate.converged:
        raise InputError(path, "", "did not converge", "mend the identification first")
    behind = [np.inf]
    if isinstance(record, IdentifyRecord):
        behind += [p.degrees_of_freedom for p in record.parameters if p.degrees_of_freedom]
    own = sha256(data_path)
    return _Known(estimate, min(behind), any(entry.sha256 == own for entry in record.inputs))


def _once(session: Session, found: Measured) -> IntArray:
    """The first reading of each configuration of which nothing was repeated."""
    poses = session.poses
    again = {poses.names.index(own.name) for own in found.cycles}
    done = {int(poses.configuration[i]) for i in again}
    first = np.unique(poses.configuration, return_index=True)[1]
    return np.sort([i for i in first if int(poses.configuration[i]) not in done]).astype(int)
