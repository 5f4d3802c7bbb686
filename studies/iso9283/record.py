"""What ``posecal iso9283`` finds, and how it is told: the criteria by name, in mm and mrad."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies import document as doc
from studies.document import MM, MRAD, Column, Rule, Shown, mm, plural
from studies.plots import style
from studies.plots.errors import over_poses
from studies.record import (
    Count,
    Entry,
    Envelope,
    From,
    IntervalEntry,
    NotNegative,
    Record,
    Three,
    ends,
    intervals,
)

if TYPE_CHECKING:
    from calib import Cell, Measurements
    from calib.arrays import IntArray
    from calib.compensation.estimate import Estimate
    from calib.iso9283 import MarkerReadings, MeasuredCriteria


_MM = 1e3  # and milliradians

FIGURE = Rule(lambda f: MM(f.value))
"""The value of a criterion, mm."""
_END = Rule(MM.show, absent="open")
_RANGE = Rule(lambda f: f"{_END(f.low)} to {_END(f.high)}", absent="")
_ANGLES = Rule(lambda values: " ".join(MRAD(value) for value in values))
_UNPREDICTED = {"left": None, "angles": None, "drift": None, "approach": "", "cycles": 0}
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

    estimate, freedom, same_data = _known(cell, data, data_path, result_path)
    session = session_of(estimate, data, marker)
    found = measured(session)
    expected = predicted(cell, session, _once(session, found), freedom)
    return Iso9283Record.from_result(
        found,
        **made_from,
        warnings=(*data.warnings, *estimate.notes),
        marker=session.model.marker_names[session.marker],
        same_data=same_data,
        instrument_rp_mm=repeatability_of(np.eye(3) * session.sigma**2) * _MM,
        poses=(
            *(PoseEntry.from_result(c, how="measured", cycles=len(c.points)) for c in found.cycles),
            *(
                PoseEntry.from_result(
                    {"accuracy": (own.accuracy, own.off), **_UNPREDICTED}, own, how="predicted"
                )
                for own in expected.poses
            ),
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


def _known(
    cell: Cell, data: Measurements, data_path: Path, path: Path | None
) -> tuple[Estimate, float, bool]:
    """An estimate, degrees of freedom behind it, and whether it was fitted to the table in hand."""
    import calib
    from calib.compensation.estimate import estimate_of
    from calib.errors import InputError
    from calib.files.estimate import load_estimate
    from calib.files.read import sha256
    from studies.identify.record import IdentifyRecord
    from studies.results import read

    if path is None:
        fitted = calib.identify(cell, data)
        return estimate_of(fitted), fitted.freedom, True
    record, estimate = read(path), load_estimate(cell, path)
    if not estimate.converged:
        raise InputError(path, "", "did not converge", "mend the identification first")
    behind = [np.inf]
    if isinstance(record, IdentifyRecord):
        behind += [p.degrees_of_freedom for p in record.parameters if p.degrees_of_freedom]
    own = sha256(data_path)
    return estimate, min(behind), any(entry.sha256 == own for entry in record.inputs)


def _once(session: MarkerReadings, found: MeasuredCriteria) -> IntArray:
    """The first reading of each configuration of which nothing was repeated."""
    poses = session.poses
    again = {poses.names.index(own.name) for own in found.cycles}
    done = {int(poses.configuration[i]) for i in again}
    first = np.unique(poses.configuration, return_index=True)[1]
    return np.sort([i for i in first if int(poses.configuration[i]) not in done]).astype(int)


_MOST = 8
_CYCLES = 30  # that the standard asks for
_SHARE = 0.25  # of a criterion that the measurement's own uncertainty may take (ISO 9283, 6.6)
_SOFT = doc.Rule(lambda f: f"{1e3 * f.value:.4g}")
_SOFT_RANGE = doc.Rule(
    lambda f: "open" if None in (f.low, f.high) else f"{1e3 * f.low:.3g} to {1e3 * f.high:.3g}"
)


_AP, _RP = interval_columns("AP", "ap_mm"), interval_columns("RP", "rp_mm")
_MEASURED = doc.columns(
    PoseEntry, "pose approach cycles", *_AP, "ap_identified_mm", *_RP, "drift_mm"
)
_TURNED = doc.columns(PoseEntry, "pose approach ap_angles_mrad rp_angles_mrad")
_PREDICTED = doc.columns(PoseEntry, "pose", *_AP, *_RP)
_DISTANCES = doc.columns(
    DistanceEntry,
    "first second cycles commanded_mm",
    *interval_columns("AD", "ad_mm"),
    *interval_columns("RD", "rd_mm"),
)
_SEVERAL = doc.columns(DirectionVariation, "pose ways vap_mm")
_COMPLIANCE = doc.columns(
    ComplianceEntry,
    "pose direction how readings",
    doc.Column("compliance", lambda row: row.mm_per_n, _SOFT, "um/N"),
    doc.Column("95 %", lambda row: row.mm_per_n, _SOFT_RANGE, "um/N"),
)


def told(record: Iso9283Record) -> doc.Document:
    """The worst figures first, then each criterion by pose."""
    return doc.Document(
        tuple(_headline(record)),
        (doc.Section("iso9283", "Criteria of ISO 9283", tuple(_parts(record))),),
    )


def _headline(record: Iso9283Record) -> Iterator[doc.Sentence]:
    repeated = record.of("measured")
    if repeated:
        ap = max(repeated, key=lambda own: own.ap_mm.value)
        rp = max(own.rp_mm.value for own in repeated if own.rp_mm is not None)
        few = min(own.cycles for own in repeated)
        asked = f", of {_CYCLES} that ISO 9283 asks for" if few < _CYCLES else ""
        yield doc.Sentence(
            f"{plural(len(repeated), 'pose')} measured again at {record.marker} ({few} cycles or "
            f"more{asked}): AP {mm(ap.ap_mm.value)} at worst, RP {mm(rp)}."
        )
    else:
        worst = max(own.ap_mm.value for own in record.poses)
        yield doc.Sentence(
            f"No pose was measured twice: AP of {plural(len(record.poses), 'pose')} at "
            f"{record.marker} is predicted, {mm(worst)} at worst.",
            "warn",
        )
    if record.same_data:
        yield doc.Sentence(
            "AP is too good: base and markers were fitted to these readings. ISO 9283 asks for an "
            "independent base. Give RESULT, from other poses.",
            "warn",
        )
    loud = [p for p in repeated if p.rp_mm and record.instrument_rp_mm > _SHARE * p.rp_mm.value]
    if loud:
        yield doc.Sentence(
            f"RP of {plural(len(loud), 'pose')} includes the instrument, which alone shows an RP of "
            f"{mm(record.instrument_rp_mm)}.",
            "warn",
        )


def _parts(record: Iso9283Record) -> Iterator[doc.Part]:
    yield doc.Figure(lambda: accuracy_and_repeatability(record))
    if repeated := record.of("measured"):
        caption = (
            "AP: mean attained less commanded point, in the base frame of the result; identified: less "
            "what the identified arm predicts, as corrected commands would have it. RP: mean distance "
            "from the mean and three standard deviations. dAP: of means of ten cycles"
        )
        yield doc.Table(_MEASURED, repeated, "Poses measured again", caption, True, _MOST)
        turned = [pose for pose in repeated if pose.ap_angles_mrad is not None]
        angles = doc.Table(_TURNED, turned, "Angles", "About x, y, z of the base", True, fold=True)
        yield doc.Detail((angles,) if turned else ())
    if record.several:
        yield doc.Table(
            _SEVERAL, record.several, "Poses reached from several sides", "", True, _MOST
        )
    if record.distances:
        yield doc.Table(_DISTANCES, record.distances, "Distances between poses", "", True, _MOST)
    if expected := record.of("predicted"):
        caption = (
            "Predicted for nominal commands by the identified arm. RP follows from the arm's "
            "repeatability where the data or the cell tell it. Drift and vAP are not predicted"
        )
        yield doc.Table(_PREDICTED, expected, "Predicted", caption, True, _MOST)
    if record.compliance:
        caption = "Static compliance: displacement along the force by it, in axes of the base"
        yield doc.Table(_COMPLIANCE, record.compliance, "Static compliance", caption, True, _MOST)


@style.styled
def accuracy_and_repeatability(record: Iso9283Record) -> style.Picture:
    """Measured poses filled, predicted ones open; the interval as a line."""
    figure = style.sheet(style.PANEL, 5.0)
    panels = figure.subplots(2, 1, sharex=True)  # AP is often a hundred times RP
    handles: list[Any] = []
    names = [pose.pose for pose in record.poses]
    for panel, name, color, mark, found in (
        (panels[0], "AP", style.VERMILLION, "^", [pose.ap_mm for pose in record.poses]),
        (panels[1], "RP", style.BLUE, "o", [pose.rp_mm for pose in record.poses]),
    ):
        values = intervals(found)
        values[1:] = np.where(np.isnan(values[1:]), values[0], values[1:])  # an open end
        series = []
        for how, face in (("measured", color), ("predicted", "none")):
            own = np.array([pose.how == how for pose in record.poses])
            look = style.Look(f"{name}, {how}", color, mark, "", "", "", face)
            if (own & np.isfinite(values[0])).any():
                series.append((look, np.where(own, values, np.nan)))
        handles += over_poses(panel, names, series, f"{name} [mm]")
    style.legend_below(figure, handles)
    caption = (
        f"Pose accuracy AP and pose repeatability RP of ISO 9283 at {record.marker}, with 95 % "
        "intervals: of the mean of the cycles and of their scatter where poses were repeated, of the "
        "identified arm where not."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (pose.pose, pose.approach, pose.how, *ends(pose.ap_mm), *ends(pose.rp_mm))
        for pose in record.poses
    )
    header = ("pose", "from", "how", "AP [mm]", "low", "high", "RP [mm]", "low", "high")
    title = "Accuracy (AP) and repeatability (RP) of each pose, by ISO 9283"
    return style.Picture("iso9283", title, caption, figure, header, rows)
