"""DLR's humanoid Agile Justin: two arms of seven joints on one torso, beside what is published.

    python -m studies.research.justin [--model NAME ..] [--json FILE]

The public table has 400 poses of both arms; each fifth of them is held out in turn, and nothing is
fitted again on it. Both arms are one robot with two tips. The torso's fourth joint has no drive: it is
moved by the two before it. Published (Tenhumberg and Baeuml 2021) are means of all 500 poses, mm.
"""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import calib
from calib.poses import Measurements
from studies.research.bench import Output, Row, bench, data_folder, real_data, several, table

SIDES = ("left", "right")
_GEOMETRY = ("base", "tool", "geometry")
_SOFT = ("joint_compliance", "bearing_compliance", "base_compliance")
MODELS: Mapping[str, tuple[str, ...]] = {
    "base and markers": ("base", "tool"),
    "joint offsets": ("base", "tool", "joint_offset"),
    "geometry": _GEOMETRY,
    "+ joint compliance": (*_GEOMETRY, "joint_compliance"),
    "+ lateral compliance": (*_GEOMETRY, "joint_compliance", "bearing_compliance"),
    "+ a base that tilts": (*_GEOMETRY, *_SOFT),
    "+ gear ratios": (*_GEOMETRY, *_SOFT, "transmission_scale"),
}
PUBLISHED = dict(zip(MODELS, (21.33, 18.18, 10.5, 5.64, 3.12), strict=False))
_FOLDS = 5
_CELL = """schema = 1
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
        joints: Row = {f"t{k}_rad": left[f"t{k}_rad"] for k in (1, 2, 3)}
        for side in SIDES:
            joints |= {f"{side}_a{k}_rad": read[side][pose][f"a{k}_rad"] for k in range(1, 8)}
        for side in SIDES:
            point = {key: read[side][pose][key] for key in ("x_mm", "y_mm", "z_mm")}
            yield {"pose": pose, "marker": side, **joints, **point}


def justin() -> tuple[calib.Cell, Measurements]:
    """Both arms on the torso, and their public readings."""
    source = data_folder("justin")
    rows = list(rows_of(source))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.urdf").write_text(robot_text(source), encoding="utf-8")
        (folder / "cell.toml").write_text(_CELL, encoding="utf-8")
        with (folder / "measurements.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        cell = calib.load_cell(folder / "cell.toml")
        return cell, calib.load_measurements(cell, folder / "measurements.csv")


def alone(side: str) -> tuple[calib.Cell, Measurements]:
    """One arm as a chain of its own, as the public files have it."""
    return real_data("justin", f"{side}.toml", f"{side}.csv")


def fitted(cell: calib.Cell, data: Measurements, model: str) -> Row:
    """How far a model is from points that took part in its fits, and from points that did not."""
    cell, rank = replace(cell, effects=MODELS[model]), 0
    fits, apart = list[float](), list[float]()
    for fold in range(_FOLDS):
        held = np.arange(len(data.poses)) % _FOLDS == fold
        found = calib.identify(cell, data.take(~held))
        rank = found.choice.rank
        for part, errors in ((data.take(~held), fits), (data.take(held), apart)):
            off = np.linalg.norm(found.model.off(found.values, part), axis=-1)
            errors.append(float(off.mean()) * 1e3)
    return {
        "mean distance, mm": model,
        "published": PUBLISHED.get(model),
        "held out": float(np.mean(apart)),
        "by fold": f"{min(apart):.2f} to {max(apart):.2f}",
        "fitted": float(np.mean(fits)),
        "parameters": rank,
    }


@bench(several("--model", tuple(MODELS), help="Models that are fitted."))
def main(seed: int, model: Sequence[str]) -> Output:
    """Identify both arms of Agile Justin, model by model, and judge them on held-out poses."""
    del seed
    cell, data = justin()
    rows = [fitted(cell, data, name) for name in model]
    return [table(rows)], {"models": rows}


if __name__ == "__main__":
    main()
