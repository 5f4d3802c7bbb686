"""Agile Justin as one robot: both public chains on one torso, and their readings in one table."""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import calib
from calib.poses import Measurements
from studies.research.bench import Row, data_folder

SIDES = ("left", "right")
_TORSO = 4
HEAD = """
schema = 1
name = "justin"
[robot]
urdf = "robot.urdf"
base = "base_link"
tip = "right_l10"
[robot.coupled.t4]
of = { t2 = -1, t3 = -1 }
"""
SIGMA_MM = 0.5
TRACKED = f"""
[markers_mm]
right = [105, 203, -22]
left = {{ position = [100, 174, 17], on = "left_l10" }}
[instrument]
sigma_mm = {SIGMA_MM}
"""
_MODEL = """
[model]
effects = [{}]
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


def write(folder: Path, effects: Sequence[str]) -> Path:
    """Cell, URDF and readings of both arms in a folder; returns the path of the cell."""
    source = data_folder("justin")
    folder.mkdir(parents=True, exist_ok=True)
    rows = list(rows_of(source))
    model = _MODEL.format(", ".join(f'"{effect}"' for effect in effects))
    (folder / "robot.urdf").write_text(robot_text(source), encoding="utf-8")
    (folder / "cell.toml").write_text(HEAD + TRACKED + model, encoding="utf-8")
    with (folder / "measurements.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return folder / "cell.toml"


def justin() -> tuple[calib.Cell, Measurements]:
    """Both arms on the torso, and their public readings."""
    with tempfile.TemporaryDirectory() as name:
        cell = calib.load_cell(write(Path(name), ("base", "tool")))
        return cell, calib.load_measurements(cell, Path(name) / "measurements.csv")


def alone(side: str) -> tuple[calib.Cell, Measurements]:
    """One arm as a chain of its own, as the public files have it."""
    folder = data_folder("justin")
    cell = calib.load_cell(folder / f"{side}.toml")
    return cell, calib.load_measurements(cell, folder / f"{side}.csv")
