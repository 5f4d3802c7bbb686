"""The cell: robot, markers, instrument, load, model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib import Cell
from studies.document import Section
from studies.document.page import shown, table_of
from studies.report.evidence import Evidence


def cell(evidence: Evidence) -> Section | None:
    """What was measured with what."""
    if evidence.cell is None:
        return None
    own = evidence.cell
    facts = table_of(("", ""), list(_facts(own)))
    units = np.where(own.robot.prismatic, "mm", "deg")
    scale = np.where(own.robot.prismatic, 1e3, 180.0 / np.pi)
    joints = table_of(
        ("joint", "moves", "from", "to", "unit", "mass of its link [kg]"),
        [
            (name, "slides" if slides else "turns", *_range(limits * factor), unit, mass or None)
            for name, slides, limits, factor, unit, mass in zip(
                own.robot.joints, own.robot.prismatic, own.robot.limits, scale, units,
                own.robot.masses.tolist(), strict=True,
            )
        ],
        "Joints, with the limits of the cell",
    )  # fmt: skip
    return Section("cell", "The cell", (facts, joints))


def _range(
    limits: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> tuple[float | None, float | None]:
    low, high = (float(x) if np.isfinite(x) else None for x in limits)
    return low, high


def _facts(own: Cell) -> Iterator[tuple[str, str]]:
    robot = own.robot
    yield "robot", f"{robot.name}, {robot.dof} joints, {robot.base} to {robot.tip}"
    yield (
        "reference points",
        ", ".join(
            f"{name} ({', '.join(shown(x * 1e3) for x in place)}) mm"
            for name, place in zip(own.marker_names, own.markers.tolist(), strict=True)
        ),
    )
    yield "noise of one coordinate", _noise(own)
    yield (
        "instrument",
        "place not given: it may stand anywhere"
        if own.instrument is None
        else f"at ({', '.join(shown(x * 1e3) for x in own.instrument.tolist())}) mm from the base",
    )
    if own.load is not None:
        at = ", ".join(shown(x * 1e3) for x in own.load.com)
        yield (
            "load of a plan's second reading",
            f"{shown(own.load.mass)} kg at ({at}) mm of the tip",
        )
    if own.payload.mass:
        yield "payload", f"{shown(float(own.payload.mass))} kg"
    yield "what the model contains", ", ".join(own.effects)


def _noise(own: Cell) -> str:
    """Along and across the beam where these differ, or grow with range."""
    noise = own.noise
    if not noise.grows:
        return f"{shown(noise.along * 1e3)} mm"
    near, far = (
        noise.deviations(np.array([1.0, 0.0, 0.0])),
        noise.deviations(np.array([5.0, 0.0, 0.0])),
    )
    said = [f"{shown(float(along) * 1e3)} mm along and {shown(float(across) * 1e3)} mm across the beam"
            for along, across in (near, far)]  # fmt: skip
    return f"{said[0]} at 1 m, {said[1]} at 5 m"
