"""Two results of identify as they are compared: refused where they are of different robots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib import Cell, load_cell, load_measurements
from calib.change import DayEstimate
from calib.compensation.estimate import Estimate
from calib.errors import InputError
from calib.files.estimate import load_estimate
from calib.files.read import sha256
from calib.poses import Poses
from studies.identify.record import IdentifyRecord
from studies.results import located, read_as

_LEANING = (
    "identified beside the robot's type ([model.prior]): what the readings say little of looks "
    "unchanged; identify both days without it to be sure"
)  # both results then err towards the same mean


@dataclass(frozen=True, eq=False)
class ComparedDays:
    """What two results know.

    cell, estimate : of the later one
    notes : tuple of str, what could not be done
    """

    before_path: Path
    after_path: Path
    cell: Cell
    before: DayEstimate
    after: DayEstimate
    estimate: Estimate
    notes: tuple[str, ...]


def days_of(before_path: Path, after_path: Path, cell_path: Path | None) -> ComparedDays:
    """Read both results and the cell of the later one.

    Raises InputError: no results of identify, one that did not converge, results of different robots,
    a cell that is gone.
    """
    before, after = (read_as(path, IdentifyRecord) for path in (before_path, after_path))
    for path, record in ((before_path, before), (after_path, after)):
        if not record.estimate.converged:
            raise InputError(path, "", "did not converge", "mend the identification first")
    cell = load_cell(_cell_file(after_path, after) if cell_path is None else cell_path)
    for path, record in ((before_path, before), (after_path, after)):
        _check_robot(cell, path, record)
    tables = [_poses(cell, path, own) for path, own in ((before_path, before), (after_path, after))]
    estimate = load_estimate(cell, after_path)
    return ComparedDays(
        before_path,
        after_path,
        cell,
        known_of_record(before, tables[0][0]),
        known_of_record(after, tables[1][0]),
        estimate,
        (
            *estimate.notes,
            *([_LEANING] if before.of_type is not None or after.of_type is not None else []),
            *(note for _, notes in tables for note in notes),
        ),
    )


def _behind_noise(record: IdentifyRecord) -> float:
    """Degrees of freedom of the noise; before results had them, of the residuals."""
    noise = record.noise
    if noise.source == "cell":
        return np.inf
    own = noise.degrees_of_freedom
    return float(record.degrees_of_freedom) if own is None else own


def _cell_file(path: Path, record: IdentifyRecord) -> Path:
    """The cell that a result names, as long as it is unchanged."""
    source = located(path, record.inputs[0].file, record.inputs[0].sha256)
    if source.path is None:
        raise InputError(
            path, "inputs", f"its cell {source.file} is {source.state}", "give it with --cell"
        )
    return source.path


def _check_robot(cell: Cell, path: Path, record: IdentifyRecord) -> None:
    """Values count from a nominal model: another one makes them another robot's."""
    known = {entry.sha256 for entry in record.inputs}
    for file in cell.robot_files:
        if sha256(file) not in known:
            raise InputError(
                path,
                "inputs",
                f"was not made with the {cell.robot.source} {file} as it stands",
                "compare results of one robot, identified from one nominal model",
            )


def _poses(cell: Cell, path: Path, record: IdentifyRecord) -> tuple[Poses | None, tuple[str, ...]]:
    """The poses of the fit, from the table that a result names; a note where it is gone."""
    sources = record.inputs[1 + len(cell.robot_files) :][:1]
    for entry in sources:
        source = located(path, entry.file, entry.sha256)
        if source.path is None:
            note = f"{source.file} is {source.state}: what the model lacks may pass for a change"
            return None, (note,)
        poses = load_measurements(cell, source.path, every_marker=False).poses
        out = {entry.pose for entry in record.outliers}
        fitted = {row.pose for row in record.residuals if not row.heldout} - out
        return poses.take(np.flatnonzero([name in fitted for name in poses.names])), ()
    return None, ()


def known_of_record(record: IdentifyRecord, poses: Poses | None) -> DayEstimate:
    """What a result knows; poses : those of the fit."""
    estimate, scatter = record.estimate, record.estimate.scatter_si
    scatters = scatter is not None and any((*scatter.approach, *scatter.configuration))
    keys = tuple((p.effect, p.where, p.name) for p in estimate.parameters)
    rms = record.rms_mm
    # Without any length read, what scatters across the line of sight stands for it.
    left = (rms.fitted or rms.fitted_all or 2.0**0.5 * record.noise.sigma_mm) * 1e-3
    lost = [f"{effect}:{where}.{name}" in estimate.undetermined for effect, where, name in keys]
    return DayEstimate.of_fit(
        np.array(estimate.covariance_si),
        keys=keys,
        values=np.array([p.value_si for p in estimate.parameters]),
        lost=np.array(lost),
        markers={name: np.array(at) * 1e-3 for name, at in record.markers_mm.items()},
        noise_dof=_behind_noise(record),
        sigma=record.noise.believed_sigma_mm * 1e-3,
        scatters=scatters,
        left=left,
        counts=(record.poses, record.points),
        poses=poses,
    )
