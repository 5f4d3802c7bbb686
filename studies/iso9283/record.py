"""What ``posecal iso9283`` finds: the criteria by name, lengths in mm and angles in mrad."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from studies.document import MM, MRAD, Column, Rule, Shown
from studies.record import Count, Entry, Envelope, From, IntervalEntry, NotNegative, Record, Three

if TYPE_CHECKING:
    from calib import Cell, Measurements
    from calib.arrays import IntArray
    from calib.compensation.estimate import Estimate
    from calib.iso9283 import MarkerReadings, MeasuredCriteria
    from calib.iso9283.predicted import PredictedPose as Expected


_MM = 1e3  # and milliradians

FIGURE = Rule(lambda f: MM(f.value))
"""The value of a criterion, mm."""
_END = Rule(MM.show, absent="open")
_RANGE = Rule(lambda f: f"{_END(f.low)} to {_END(f.high)}", absent="")
_ANGLES = Rule(lambda values: " ".join(MRAD(value) for value in values))
How = Literal["measured", "predicted"]


class PoseEntry(Entry):
    """One pose from one side.

    approach : signs of the joints' last motions, empty where the table does not say them
    ap : of the nominal command, with its coordinates in the base frame; ap_identified : against what
        the identified arm predicts, as corrected commands would have it
    drift : dAP; None where fewer than twice ten cycles
    """

    pose: Annotated[str, From("name")]
    approach: Annotated[str, Shown("from")]
    how: How
    cycles: Count
    ap_mm: Annotated[IntervalEntry, From("accuracy.0")]
    ap_xyz_mm: Annotated[Three, From("accuracy.1")]
    ap_identified_mm: Annotated[IntervalEntry | None, Shown("AP identified", FIGURE), From("left")]
    rp_mm: Annotated[IntervalEntry | None, From("repeatability")]
    ap_angles_mrad: Annotated[Three | None, Shown("AP a, b, c", _ANGLES), From("angles.0")]
    rp_angles_mrad: Annotated[Three | None, Shown("RP a, b, c", _ANGLES), From("angles.1")]
    drift_mm: Annotated[NotNegative | None, Shown("dAP")]


class DirectionVariation(Entry):
    """vAP: the largest distance between the mean points of several ways of coming."""

    pose: str
    ways: Annotated[Count, Shown("approach directions")]
    vap_mm: Annotated[NotNegative, Shown("vAP")]


class DistanceEntry(Entry):
    """AD and RD between two poses."""

    first: Annotated[str, Shown("from")]
    second: Annotated[str, Shown("to")]
    cycles: Count
    commanded_mm: NotNegative
    ad_mm: Annotated[IntervalEntry, From("accuracy")]
    rd_mm: Annotated[IntervalEntry, From("repeatability")]


class ComplianceEntry(Entry):
    """Displacement along a force of the base's axes, by that force."""

    pose: Annotated[str, From("name")]
    direction: Annotated[str, Shown("force along")]
    how: How
    readings: Count
    mm_per_n: Annotated[IntervalEntry, From("figure")] = Field(alias="mm_per_N")


def interval_columns(title: str, of: str) -> tuple[Column[PoseEntry | DistanceEntry], ...]:
    """A criterion and its interval."""
    value = attrgetter(of)
    return Column(title, value, FIGURE, "mm"), Column("95 %", value, _RANGE, "mm")


class Iso9283Record(Record):
    """The criteria of ISO 9283.

    same_data : whether base and markers were fitted to these very readings, which flatters AP
    instrument_rp_mm : RP that the instrument alone would show
    """

    command: Literal["iso9283"] = "iso9283"
    marker: str
    same_data: bool
    instrument_rp_mm: NotNegative
    poses: tuple[PoseEntry, ...] = Field(min_length=1)
    several: tuple[DirectionVariation, ...]
    distances: tuple[DistanceEntry, ...]
    compliance: tuple[ComplianceEntry, ...]

    @model_validator(mode="after")
    def _repeats_are_whole(self) -> Self:
        if any(own.how == "measured" and own.rp_mm is None for own in self.poses):
            raise ValueError("a measured pose lacks rp_mm")
        return self

    def of(self, how: How) -> list[PoseEntry]:
        """The poses that were repeated, or those that were not."""
        return [own for own in self.poses if own.how == how]


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

    known = _fitted(cell, data) if result_path is None else _read(cell, data_path, result_path)
    session = session_of(known.estimate, data, marker)
    found = measured(session)
    expected = predicted(cell, session, _once(session, found), known.freedom)
    return Iso9283Record.from_result(
        found,
        **made_from,
        warnings=(*data.warnings, *known.estimate.notes),
        marker=session.model.marker_names[session.marker],
        same_data=known.same_data,
        instrument_rp_mm=repeatability_of(np.eye(3) * session.sigma**2) * _MM,
        poses=(
            *(PoseEntry.from_result(c, how="measured", cycles=len(c.points)) for c in found.cycles),
            *map(_predicted, expected.poses),
        ),
        several=[
            DirectionVariation(pose=name, ways=ways, vap_mm=value * _MM)
            for name, (value, ways) in found.several.items()
        ],
        compliance=[
            ComplianceEntry.from_result(own, how=how)
            for how, every in (("measured", found.compliance), ("predicted", expected.compliance))
            for own in every
        ],
    )


def _predicted(own: Expected) -> PoseEntry:
    found = {"accuracy": (own.accuracy, own.off), "left": None, "angles": None, "drift": None}
    return PoseEntry.from_result(found, own, approach="", how="predicted", cycles=0)


class _EstimateOfTable(NamedTuple):
    """An estimate, degrees of freedom behind it, and whether it was fitted to the table in hand."""

    estimate: Estimate
    freedom: float
    same_data: bool


def _fitted(cell: Cell, data: Measurements) -> _EstimateOfTable:
    import calib
    from calib.compensation.estimate import estimate_of

    found = calib.identify(cell, data)
    return _EstimateOfTable(estimate_of(found), found.freedom, True)


def _read(cell: Cell, data_path: Path, path: Path) -> _EstimateOfTable:
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
    return _EstimateOfTable(
        estimate, min(behind), any(entry.sha256 == own for entry in record.inputs)
    )


def _once(session: MarkerReadings, found: MeasuredCriteria) -> IntArray:
    """The first reading of each configuration of which nothing was repeated."""
    poses = session.poses
    again = {poses.names.index(own.name) for own in found.cycles}
    done = {int(poses.configuration[i]) for i in again}
    first = np.unique(poses.configuration, return_index=True)[1]
    return np.sort([i for i in first if int(poses.configuration[i]) not in done]).astype(int)
