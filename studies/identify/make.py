"""From a session to its identification, and to the record of that."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calib
from calib import Identification
from calib.arm.se3 import so3_exp, so3_log
from calib.arrays import Array
from calib.identification import ADVICE
from calib.identification.drift import drift_p
from calib.identification.fit import Method
from calib.instruments import Pose as PoseInstrument
from calib.observations import Approach, Weighting
from calib.poses.moves import thinned
from calib.prediction.budget import accuracy_at_targets
from calib.prediction.estimate import estimate_of
from studies.command.options import faults_in
from studies.command.session import MeasuredTable
from studies.fitted import estimated
from studies.identify.budget import acceptance_entry, budget_entry
from studies.identify.errors import (
    IdentifyResidual,
    OfInstrument,
    distances_entry,
    outlier_entries,
    pair_entries,
    rms_of,
)
from studies.identify.parameters import (
    RedundantParameter,
    lens_entries,
    parameter_entries,
    sizes_entry,
)
from studies.identify.record import IdentifyNoise, IdentifyRecord, Placement, Placements
from studies.noise import noise_fields
from studies.record import envelope

_MM = 1e3
MOST = 200_000
"""Readings of a table that are identified: they take 15 kB each."""
SECONDS = 0.8e-3
"""What each of them takes, s, as measured (``studies.research.benchmarks.speeds``)."""


def inputs_of(session: MeasuredTable) -> list[Path]:
    """What the record is made from, the cell first."""
    return [*session.read, *session.named, *session.held.files]


def identified(
    session: MeasuredTable,
    *,
    approach: Approach = "points",
    method: Method = "joint",
    weighting: Weighting = "full",
    length_mm: float = 1000.0,
) -> tuple[Identification, IdentifyRecord]:
    """Identify a session.

    length_mm : characteristic length of the plain weighting

    Raises InputError naming the file that is at fault.
    """
    cell, held = session.cell, session.held
    data, said = thinned(held.data, MOST)
    with faults_in(session.data_path, effects_of=cell.path):
        found = calib.identify(
            cell, data, heldout=held.heldout, approach=approach, method=method,
            weighting=weighting, length=length_mm * 1e-3,
        )  # fmt: skip
    of_pose = approach == "pose"
    record = _record(
        session,
        found,
        warnings=(*held.warnings, *said, *found.warnings),
        weighting=weighting if of_pose else None,
        length_mm=length_mm if of_pose and weighting == "plain" else None,
    )
    return found, record


def _record(session: MeasuredTable, found: Identification, **asked: object) -> IdentifyRecord:
    """The record of an identification; asked : warnings, and what the caller chose."""
    cell, fit, held = session.cell, found.fit, found.heldout
    estimate = estimate_of(found, cell.design.targets_after or 0.0)
    accuracy = accuracy_at_targets(cell, found, estimate)
    tracked = found.model.tracked(session.whole)
    parts = [part for part in (fit, held) if part is not None]
    return IdentifyRecord.from_result(
        found,
        **envelope(cell.name, inputs_of(session), session.seed, cell.about),
        **asked,
        holdout=session.holdout,
        advice=ADVICE[found.status],
        noise=_noise(found),
        points=int(fit.data.seen.sum()),
        parameters=parameter_entries(found),
        unused_poses=(*found.unused, *found.waiting),
        absorbed=[
            RedundantParameter(id=own.id, absorbed_by=tuple(name for name, _ in own.absorbed_by))
            for own in found.absorbed
            if own.absorbed_by
        ],
        outliers=outlier_entries(fit, found.model, found.footprint),
        heldout_outliers=()
        if held is None
        else outlier_entries(held, found.model, found.footprint),
        rms_mm=distances_entry(found, rms_of),
        max_mm=distances_entry(found, lambda d: float(d.max())),
        p95_mm=distances_entry(found, lambda d: float(np.quantile(d, 0.95))),
        instruments=[
            OfInstrument.model_validate({"instrument": name, "unit": unit, **rms})
            for (name, unit), rms in found.by_instrument.items()
        ],
        pair_distances_mm=dict(pair_entries(found)),
        rms_of_residuals_mm=rms_of(fit.lengths()) * _MM if fit.channels.metric else None,
        **_placements(found),
        correlation=np.round(found.correlation, 4),
        residuals=[
            row
            for part in parts
            for row in IdentifyResidual.of_readings(
                found.model,
                part.data,
                found.model.off(found.nominal, part.data),
                part.vectors,
                part is held,
            )
        ],
        task_rms_mm=accuracy.rms(accuracy.expected.errors) * _MM,
        task_worst_mm=accuracy.worst(accuracy.expected.errors) * _MM,
        targets=accuracy.source,
        budget=budget_entry(accuracy),
        acceptance=acceptance_entry(cell.tolerance, held),
        drift_p=None if tracked is None else drift_p(tracked[1]),
        sizes=found.sizes and sizes_entry(found.sizes),
        lenses=lens_entries(found),
        estimate=estimated(estimate),
    )


def _noise(found: Identification) -> IdentifyNoise:
    noise, again = found.noise, found.noise.replicate_factor
    believed_mm = noise.believed * found.footprint * _MM
    return IdentifyNoise.from_result(
        noise,
        replicate_sigma_mm=None if again is None else again * believed_mm,
        **noise_fields(noise, found.levels, found.scatter, found.model, found.footprint),
    )


def _placements(found: Identification) -> dict[str, object]:
    """Where the base, the bodies, and the markers that are read by their names are."""
    model = found.model
    stations = {where: _placement(placed) for where, placed in found.bases.items()}
    first = next(iter(stations.values()), _placement(np.zeros(6)))
    bodies = {
        model.marker_names[at]: _placement(np.concatenate(body))
        for i in model.instruments
        if isinstance(i, PoseInstrument)
        for at, body in i.bodies(found.marker_positions)
    }
    read: list[int] = np.unique(model.readout.channels.marker).tolist()
    return {
        "base": Placements(**dict(first), stations=stations if len(stations) > 1 else {}),
        "bodies": bodies,
        "markers_mm": {model.marker_names[j]: found.marker_positions[j] * _MM for j in read},
    }


def _placement(placed: Array) -> Placement:
    """A placement of translation and rotation vector, shape (6,), m and rad."""
    return Placement(
        rotation_vector_rad=tuple(so3_log(so3_exp(placed[3:])).tolist()),
        translation_mm=tuple((placed[:3] * _MM).tolist()),
    )
