"""What the fit leaves: distances, residuals by pose and by what they may depend on, pairs of points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from calib import Cell
from calib.arrays import Array
from studies.identify.common import shared_sentence
from studies.identify.pictures import instrument_sigma, residual_pictures, workspace_pictures
from studies.identify.point_errors import PointErrors, point_errors
from studies.plots.against import against
from studies.report.evidence import Evidence, Measured, Result
from studies.report.parts import Figure, Part, Section, Table, Text, folded

_LABELS = {
    "fitted_all": "identified model, every pose",
    "fitted": "identified model, outliers left out",
    "nominal": "nominal model, base and markers fitted",
    "heldout": "poses it never saw",
    "heldout_trimmed": "poses it never saw, without their outliers",
}


def errors(evidence: Evidence, result: Result) -> Section:
    """Errors before and after."""
    return Section("errors", "Errors before and after", tuple(_parts(evidence, result)))


def workspace(evidence: Evidence, result: Result) -> Section:
    """The accuracy to expect at poses that were not measured."""
    fields = result.fields
    parts: list[Part] = [
        Text(
            "What the uncertainty of the parameters leaves at other poses: "
            f"{fields['task_rms_mm']:.4f} mm RMS, {fields['task_worst_mm']:.4f} mm at worst "
            f"({fields['targets']})."
        ),
        *(Figure(picture) for picture in workspace_pictures(fields)),
    ]
    return Section("workspace", "Accuracy to expect elsewhere", tuple(parts))


def _parts(evidence: Evidence, result: Result) -> Iterator[Part]:
    fields = result.fields
    found = point_errors(fields["residuals"], "nominal_mm")
    sigma = instrument_sigma(fields["noise"])
    yield Table(
        ("model", "RMS [mm]", "p95 [mm]", "max [mm]"),
        [
            (label, *(fields[name][key] for name in ("rms_mm", "p95_mm", "max_mm")))
            for key, label in _LABELS.items()
            if fields["rms_mm"][key] is not None
        ],
        "Distances in space between measured and predicted points. Noise alone would leave "
        f"{3.0**0.5 * 1e3 * sigma:.4f} mm RMS.",
    )
    first, *others = residual_pictures(fields)
    yield Figure(first)
    yield from _pairs(fields)
    yield from _outliers(fields)
    for picture in others:
        yield Figure(picture)
    if fields.get("drift") is not None:
        yield from _drift(fields["drift"])
    data = evidence.data.get(result.path)
    if evidence.cell is not None and data is not None:
        yield from _against(evidence.cell, data, found, sigma)
    yield _by_pose(found)


def _pairs(fields: dict[str, Any]) -> Iterator[Part]:
    rows = [
        (_LABELS[key], own["pairs"], own["rms"], own["p95"], own["max"])
        for key, own in fields["pair_distances_mm"].items()
    ]
    if rows:
        yield Table(
            ("model", "pairs", "RMS [mm]", "p95 [mm]", "max [mm]"),
            rows,
            "Distances between points of two poses, measured minus predicted: a check that depends on "
            "no frame, since distances are the same wherever the instrument stands",
        )


def _outliers(fields: dict[str, Any]) -> Iterator[Part]:
    rows = [
        (entry["pose"], said, entry["reason"])
        for key, said in (("outliers", "left out of the fit"), ("heldout_outliers", "held out"))
        for entry in fields[key]
    ]
    if rows:
        yield Table(
            ("pose", "what became of it", "reason"), rows, "Poses that stand out", of_poses=True,
            fold=folded("Poses that stand out", rows),
        )  # fmt: skip
        if fields.get("outliers_share"):
            yield Text(shared_sentence(fields["outliers_share"]), "warn")
    else:
        yield Text("No pose was rejected.", "good")


def _drift(drift: dict[str, Any]) -> Iterator[Part]:
    """How far the poses that were measured again had moved."""
    verdicts = {
        "steady": "The poses measured again did not move beyond their noise",
        "drift": "The poses measured again moved steadily through the day",
        "moved": "The poses measured again moved beyond their noise, but not steadily",
    }
    steady, p = drift["verdict"] == "steady", drift["p_value"]
    decided = drift["trend_p"] if drift["verdict"] == "drift" else p
    yield Text(f"{verdicts[drift['verdict']]} (p {decided:.2g}).", "good" if steady else "warn")
    rows = [
        (motion["pose"], one["pose"], motion["hours"], motion["length_um"], motion["p_value"])
        for one in drift["references"]
        for motion in one["moved"]
    ]
    yield Table(
        ("measured again", "first", "hours later", "moved [um]", "p"),
        rows,
        of_poses=True,
        fold=folded("Poses measured again", rows),
    )


def _against(cell: Cell, measured: Measured, found: PointErrors, sigma: float) -> Iterator[Part]:
    """Errors over each joint, and over load, time and temperature where they vary."""
    read = [measured.reading(*row) for row in zip(found.poses, found.heldout.tolist(), strict=True)]
    found = found.take(np.array([row is not None for row in read], dtype=bool))
    rows = [row for row in read if row is not None]
    if not rows:
        return
    squared = np.where(found.seen, (found.after**2).sum(axis=-1), np.nan)
    rms = np.sqrt(np.nanmean(squared, axis=1))
    q = np.array([poses.q[i] for poses, i in rows])
    variables: dict[str, Array] = {}
    for k, (joint, slides) in enumerate(zip(cell.robot.joints, cell.robot.prismatic, strict=True)):
        label = f"{joint} [mm]" if slides else f"{joint} [deg]"
        variables[label] = q[:, k] * 1e3 if slides else np.degrees(q[:, k])
    force = np.array([float(np.linalg.norm(poses.wrench[i, :3])) for poses, i in rows])
    if np.ptp(force) > 0.0:
        variables["force on the tool [N]"] = force
    time = _known([None if poses.time is None else poses.time[i] for poses, i in rows])
    if time is not None:
        variables["time [h]"] = (time - time.min()) / 3600.0
    heat = _known([None if p.temperature is None else p.temperature[i] for p, i in rows])
    if heat is not None:
        variables["temperature [degC]"] = heat
    yield Figure(against(found.poses, rms, variables, sigma, found.heldout))


def _known(values: list[Any]) -> Array | None:
    """What every reading has, None where one lacks it."""
    return None if None in values else np.array(values, dtype=np.float64)


def _by_pose(found: PointErrors) -> Part:
    def rms(part: Array) -> Array:
        squared = np.where(found.seen, (part**2).sum(axis=-1), np.nan)
        return np.asarray(np.sqrt(np.nanmean(squared, axis=1)) * 1e3)

    rows = [
        (name, before, after, int(seen), "held out" if held else "fitted")
        for name, before, after, seen, held in zip(
            found.poses, rms(found.before).tolist(), rms(found.after).tolist(),
            found.seen.sum(axis=1), found.heldout, strict=True,
        )
    ]  # fmt: skip
    return Table(
        ("pose", "RMS before [mm]", "RMS after [mm]", "markers seen", "use"),
        rows,
        of_poses=True,
        fold=f"Errors pose by pose ({len(rows)})",
    )
