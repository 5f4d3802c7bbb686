"""What is left over each joint, and over load, time and temperature: of a result and its tables."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.poses import Poses
from studies.document import Figure, Section
from studies.identify.pictures import point_errors
from studies.identify.record import IdentifyRecord
from studies.plots import against as plot
from studies.report.evidence import Evidence, Result

Reading = tuple[Poses, int]


def against(evidence: Evidence, result: Result) -> Section | None:
    """Errors against what they may depend on; None where cell or tables are gone."""
    cell, data, record = evidence.cell, evidence.data.get(result.path), result.record
    if cell is None or data is None or not isinstance(record, IdentifyRecord):
        return None
    found = point_errors(record)
    read = [data.reading(*row) for row in zip(found.poses, found.heldout.tolist(), strict=True)]
    rows = [row for row in read if row is not None]
    if not rows:
        return None
    found = found.take(np.array([row is not None for row in read], dtype=bool))
    variables, sigma = dict(_variables(cell.robot, rows)), record.noise.instrument_mm * 1e-3
    rms = found.by_pose(found.after)
    figure = Figure(lambda: plot.against(found.poses, rms, variables, sigma, found.heldout))
    return Section("against", "What is left, against what it may depend on", (figure,))


def _variables(robot: Robot, rows: list[Reading]) -> Iterator[tuple[str, Array]]:
    q = np.array([poses.q[i] for poses, i in rows])
    for k, (joint, slides) in enumerate(zip(robot.joints, robot.prismatic, strict=True)):
        shown = (
            (f"{joint} [mm]", q[:, k] * 1e3) if slides else (f"{joint} [deg]", np.degrees(q[:, k]))
        )
        yield shown
    force = np.array([float(np.linalg.norm(poses.wrench[i, :3])) for poses, i in rows])
    if np.ptp(force) > 0.0:
        yield "force on the tool [N]", force
    time = _known([None if poses.time is None else poses.time[i] for poses, i in rows])
    if time is not None:
        yield "time [h]", (time - time.min()) / 3600.0
    heat = _known([None if p.temperature is None else p.temperature[i] for p, i in rows])
    if heat is not None:
        yield "temperature [degC]", heat


def _known(values: list[float | None]) -> Array | None:
    """What every reading has, None where one lacks it."""
    return None if None in values else np.array(values, dtype=np.float64)
