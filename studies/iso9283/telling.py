"""What the criteria of ISO 9283 say and show: the worst of each, and every pose."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from studies import document as doc
from studies.document import mm, plural
from studies.iso9283.record import (
    ComplianceEntry,
    DirectionVariation,
    DistanceEntry,
    Iso9283Record,
    PoseEntry,
    interval_columns,
)
from studies.plots import style
from studies.plots.errors import over_poses
from studies.record import ends, intervals

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
    return style.Picture(
        "iso9283",
        "Accuracy (AP) and repeatability (RP) of each pose, by ISO 9283",
        caption,
        figure,
        header,
        rows,
    )
