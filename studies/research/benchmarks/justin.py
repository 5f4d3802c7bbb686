"""DLR's humanoid Agile Justin: two arms of seven joints on one torso, a marker on each hand.

    python -m studies.research.benchmarks.justin [--days 0] [--model NAME ..] [--alone]

The public table has 400 poses of both arms; every fifth one is held out, and nothing is fitted again on
it. Both arms are one robot with two tips. The torso's fourth joint has no drive: it is moved by the two
before it. ``--alone`` fits each arm as a chain of its own, which knows nothing of the other's weight.
``--days`` draws so many days from what was identified, with the noise found, and counts how often the
intervals of 95 % hold the truth. Published (Tenhumberg and Baeuml 2021), mean of all poses in mm: 21.33
nominal, 18.18 with offsets, 10.5 with DH parameters, 5.64 with joint compliances, 3.12 (8.23 at most)
with lateral ones.
"""

from __future__ import annotations

import csv
import re
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.poses import Measurements
from studies.research.bench import Output, Row, bench, count, data_folder, several, table

SIDES = ("left", "right")
_GEOMETRY = ("base", "tool", "geometry")
MODELS: Mapping[str, tuple[str, ...]] = {
    "base and markers": ("base", "tool"),
    "joint offsets": ("base", "tool", "joint_offset"),
    "geometry": _GEOMETRY,
    "+ joint compliance": (*_GEOMETRY, "joint_compliance"),
    "+ a base that tilts": (*_GEOMETRY, "joint_compliance", "base_compliance"),
    "+ gear ratios": (*_GEOMETRY, "joint_compliance", "base_compliance", "transmission_scale"),
}
PUBLISHED = dict(zip(MODELS, (21.33, 18.18, 10.5, 5.64, 3.12), strict=False))
_EVERY, _HELD = 5, 2
_TORSO = 4
_SIGMA = 0.5e-3  # m, of a coordinate on simulated days
_HEAD = """
schema = 1
name = "justin"
[robot]
urdf = "robot.urdf"
base = "base_link"
tip = "right_l10"
[robot.coupled.t4]
of = { t2 = -1, t3 = -1 }
[markers_mm]
right = [105, 203, -22]
left = { position = [100, 174, 17], on = "left_l10" }
[instrument]
sigma_mm = 0.5
[model]
effects = ["base", "tool"]
"""
# Both chains have the torso's last frame, turned by half a turn about the axis of its last joint.
_MOUNT = (
    '<link name="right_side"/><joint name="right_side" type="fixed"><parent link="l3"/>'
    '<child link="right_side"/><origin xyz="0 0 0" rpy="0 0 3.141592653589793"/></joint>'
)


def robot_text(folder: Path) -> str:
    """Both public chains as one URDF: the torso once, joints and links of each arm by its side."""
    lines = [_MOUNT]
    for side in SIDES:
        chain = (folder / f"{side}.urdf").read_text(encoding="utf-8").splitlines()
        first = next(i for i, line in enumerate(chain) if 'name="a1"' in line)
        lines[:0] = chain[1:first] if side == "left" else []
        arm = "\n".join(chain[first:-1]).replace('"a', f'"{side}_a')
        arm = re.sub(r'"l(\d+)"', rf'"{side}_l\1"', arm)
        lines.append(arm.replace(f'"{side}_l3"', '"l3"' if side == "left" else '"right_side"'))
    return '<robot name="justin">\n' + "\n".join(lines) + "\n</robot>\n"


def rows_of(folder: Path) -> Iterator[Row]:
    """Rows of one table: the joints of both arms, and one hand's point each."""
    read = {}
    for side in SIDES:
        with (folder / f"{side}.csv").open(encoding="utf-8") as file:
            read[side] = {row["pose"]: row for row in csv.DictReader(file)}
    for pose, left in read["left"].items():
        joints: Row = {f"t{k}_rad": left[f"t{k}_rad"] for k in range(1, _TORSO)}
        for side in SIDES:
            own = read[side][pose]
            joints |= {f"{side}_a{k}_rad": own[f"a{k}_rad"] for k in range(1, 8)}
        for side in SIDES:
            point = {key: read[side][pose][key] for key in ("x_mm", "y_mm", "z_mm")}
            yield {"pose": pose, "marker": side, **joints, **point}


def justin() -> tuple[calib.Cell, Measurements]:
    """Both arms on the torso, and their public readings."""
    source = data_folder("justin")
    with tempfile.TemporaryDirectory() as name:
        folder, rows = Path(name), list(rows_of(source))
        (folder / "robot.urdf").write_text(robot_text(source), encoding="utf-8")
        (folder / "cell.toml").write_text(_HEAD, encoding="utf-8")
        with (folder / "measurements.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        cell = calib.load_cell(folder / "cell.toml")
        return cell, calib.load_measurements(cell, folder / "measurements.csv")


def alone(side: str) -> tuple[calib.Cell, Measurements]:
    """One arm as a chain of its own, as the public files have it."""
    folder = data_folder("justin")
    cell = calib.load_cell(folder / f"{side}.toml")
    return cell, calib.load_measurements(cell, folder / f"{side}.csv")


def split(data: Measurements) -> tuple[Measurements, Measurements]:
    """Those fitted, and every fifth one."""
    held = np.arange(len(data.poses)) % _EVERY == _HELD
    return data.take(~held), data.take(held)


def distances(found: calib.Identification, data: Measurements) -> Array:
    """Measured from predicted points, shape (m, M), mm; nothing fitted again."""
    return np.asarray(np.linalg.norm(found.model.off(found.values, data), axis=-1) * 1e3)


def fitted(
    cell: calib.Cell, data: Measurements, effects: Sequence[str]
) -> tuple[calib.Identification, Row]:
    """The fit of a model, and how far held-out points are from it."""
    train, held = split(data)
    begun = time.perf_counter()
    found = calib.identify(replace(cell, effects=tuple(effects)), train)
    seconds = time.perf_counter() - begun
    own, other = distances(found, train), distances(found, held)
    names = cell.marker_names
    by_hand = dict(zip(names, other.mean(axis=0).tolist(), strict=True))
    return found, {
        "parameters": found.choice.rank,
        "fitted_mean_mm": float(own.mean()),
        "mean_mm": float(other.mean()),
        "max_mm": float(other.max()),
        "by_hand_mm": by_hand,
        "seconds": seconds,
    }


def coverage(cell: calib.Cell, found: calib.Identification, data: Measurements, days: int) -> Row:
    """How often intervals of 95 % hold the truth on days drawn from an identification.

    cell : whose effects are those identified
    """
    model = found.model
    inside = []
    for day in range(days):
        rng = np.random.default_rng(day)
        readings = model.predict(found.values, data.poses)
        drawn = readings + rng.normal(size=readings.shape) * _SIGMA
        again = calib.identify(cell, replace(data, readings=drawn))
        told = {p.id: i for i, p in enumerate(again.model.parameters)}
        for p, truth in zip(model.parameters, found.values, strict=True):
            i = told.get(p.id)
            if i is not None and np.isfinite(again.std[i]) and again.std[i] > 0.0:
                inside.append(abs(again.values[i] - truth) < 1.96 * again.std[i])
    return {"days": days, "intervals": len(inside), "inside": float(np.mean(inside))}


@bench(
    count("--days", 0, least=0, help="Simulated days whose intervals are counted."),
    several("--model", tuple(MODELS), help="Models that are fitted."),
    click.option("--alone", "chains", is_flag=True, help="Each arm as a chain of its own, too."),
)
def main(seed: int, days: int, model: Sequence[str], chains: bool) -> Output:
    """Identify both arms of Agile Justin, model by model, and judge them on held-out poses."""
    del seed
    cell, data = justin()
    rows: list[Row] = []
    last: Any = None
    for name in model:
        last, row = fitted(cell, data, MODELS[name])
        rows.append({"model": name, "arms": "both", "published": PUBLISHED.get(name), **row})
        for side in SIDES if chains else ():
            _, row = fitted(*alone(side), MODELS[name])
            rows.append({"model": name, "arms": f"{side} alone", "published": None, **row})
    shown = [
        {
            "mean distance, mm": row["model"],
            "arms": row["arms"],
            "published": row["published"],
            "held out": row["mean_mm"],
            "most": row["max_mm"],
            "fitted": row["fitted_mean_mm"],
            "parameters": row["parameters"],
            "seconds": row["seconds"],
        }
        for row in rows
    ]
    found: Row = {"models": rows}
    parts: list[Any] = [table(shown)]
    if days:
        known = replace(cell, effects=MODELS[model[-1]])
        found["intervals"] = coverage(known, last, split(data)[0], days)
        own = found["intervals"]
        parts.append(f"{own['inside']:.1%} of {own['intervals']} intervals hold the truth")
    return parts, found


if __name__ == "__main__":
    main()
