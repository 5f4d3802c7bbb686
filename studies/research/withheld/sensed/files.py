"""A case as the files that a user would bring, and its key."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import EASY
from studies.research.withheld.sensed.draw import Fault, Sensed
from studies.research.withheld.sensed.figures import DRAWN
from studies.research.withheld.texts import urdf
from studies.research.withheld.units import SI, unit

_UNITS = {
    "focal_scale": ("scale", "ppm"),
    "board_scale": ("scale", "ppm"),
    "focal_drift": ("rate", "ppm/h"),
    "focal_expansion": ("growth", "ppm/K"),
}


def write_case(folder: Path, case: Sensed) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder."""
    folder.mkdir(parents=True)
    held = case.scene.session.held
    texts = {
        "cell.toml": cell_text(folder.name, case),
        "robot.urdf": urdf(case.scene.arm, case.scene.weighs),
        "measurements.csv": table_text(case, np.flatnonzero(~held)),
        "heldout.csv": table_text(case, np.flatnonzero(held)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")


def cell_text(name: str, case: Sensed) -> str:
    """The measurement cell with the user's model: nothing but places."""
    arm = case.scene.arm
    return (
        f'schema = 1\nname = "{name}"\n[robot]\nurdf = "robot.urdf"\nbase = "{arm.base}"\n'
        f'tip = "{arm.tip}"\n{case.reader.cell}[model]\neffects = ["base", "tool"]\n'
    )


def table_text(case: Sensed, poses: NDArray[np.int_]) -> str:
    """Rows of some poses, in order of time."""
    session, arm = case.scene.session, case.scene.arm
    header = ["pose", "instrument", "marker", *(f"{name}_deg" for name in arm.names)]
    header += ["temperature_degC", "time_s", *(f"approach_{name}" for name in arm.names)]
    header += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", *case.reader.columns]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    for i in poses:
        known = [f"{x:.10f}" for x in np.degrees(session.q[i])]
        known += [f"{session.temperature[i]:.3f}", f"{session.time[i]:.1f}"]
        known += [f"{x:.0f}" for x in session.approach[i] + 0.0]
        known += [f"{x:.4f}" for x in case.scene.wrench[i]]
        for c in np.flatnonzero(np.isfinite(case.rows[i]).all(axis=-1)).tolist():
            instrument, marker, numbers = case.reader.told(case.rows[i, c], c, int(case.site[i]))
            writer.writerow([session.names[i], instrument, marker, *known, *numbers])
    return stream.getvalue()


def key_of(case: Sensed, name: str, index: int, salt: str) -> dict[str, Any]:
    """Everything that scoring needs."""
    return {
        "schema": 1,
        "salt": salt,
        "case": name,
        "index": index,
        "draw": DRAWN,
        "family": case.family,
        "robot": case.scene.arm.name,
        "conditions": {
            **asdict(EASY),
            "known_geometry": True,
            "rigid": [],
            "reader": case.kind,
        },
        "effects": [] if case.cause is None else [_entry(case, case.cause)],
        "outside": None,
        "noncentrality": case.noncentrality,
        "floor_mm": case.reader.floor,  # px of a camera, as the answers have it
        "outliers": [],
    }


def _entry(case: Sensed, cause: Cause | Fault) -> dict[str, Any]:
    where = cause.where if isinstance(cause, Fault) else (cause.where,)
    return {
        "effect": cause.effect,
        "where": where[0],
        "places": list(where),
        "twins": [f"{cause.effect}:{other}" for other in where[1:]],
        "depends_on": [],
        "noncentrality": case.noncentrality,
        "beside": case.noncentrality,
        "parameters": list(_parameters(cause)),
    }


def _parameters(cause: Cause | Fault) -> list[dict[str, Any]]:
    """Those whose value does not hang on where the clock or a frame begins."""
    if isinstance(cause, Fault):
        own = _UNITS.get(cause.effect)
        told = [] if own is None else [(*own, cause.size / SI[own[1]])]
    else:
        named = [(n, unit(cause.effect, n), v * cause.size) for n, v in cause.values.items()]
        told = [(n, shown, v / SI[shown]) for n, shown, v in named]
    return [{"name": n, "value": v, "unit": u, "scored": True} for n, u, v in told]
