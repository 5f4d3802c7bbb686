"""A cell with two joints, its files, and the result of each command that a report takes."""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from calib import load_cell, load_plan
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.simulation import drawn_readings
from studies.cli import main

_CELL = """\
schema = 1
name = "small"
[robot]
urdf = "arm.urdf"
base = "base"
tip = "tip"
[markers_mm]
m1 = [300, 0, 0]
m2 = [0, 200, 100]
[instrument]
sigma_mm = 0.01
position_mm = [2000, -3000, 500]
[load]
mass_kg = 10
com_mm = [100, 0, 0]
[design]
poses = 4
targets = "targets.csv"
[model]
effects = ["base", "tool", "joint_offset"]
"""
URDF = """\
<robot name="arm"><link name="base"/><link name="slide"/><link name="tip"/>
<joint name="X1" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="0" velocity="1"/></joint>
<joint name="A2" type="revolute"><origin xyz="0.3 0 0.5"/><parent link="slide"/><child link="tip"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="0" velocity="1"/></joint></robot>
"""
_PLACES = ((-600, 40), (-300, -80), (0, 0), (350, 70), (500, -30), (800, 20), (650, 85), (-600, 40))
_COMMANDS = (
    ("identified", "identify", "identify cell.toml data.csv --holdout 0.3"),
    ("diagnosed", "diagnose", "diagnose cell.toml data.csv"),
    ("sight", "plan", "diagnose cell.toml plan.csv --plan-only"),
    ("designed", "design", "design cell.toml --candidates 40"),
    ("compared", "compare", "compare cell.toml plan.csv --monte-carlo 10 --workers 1"),
    ("enough", "enough", "enough cell.toml data.csv --plan plan.csv --goal-mm 0.1"),
    ("compensated", "compensate", "compensate cell.toml identified.json targets.csv"),
)

KINDS = {own: kind for own, kind, _ in _COMMANDS}
"""Kind of the result, by the name that it has here."""


def _table(places: Sequence[tuple[int, int]]) -> str:
    rows = [f"p{i},{x},{angle}" for i, (x, angle) in enumerate(places)]
    return "\n".join(["pose,X1_mm,A2_deg", *rows, ""])


@functools.cache
def _made() -> tuple[dict[str, str], dict[str, Any]]:
    """Texts of the cell's files, by name, and the results."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        texts = {
            "cell.toml": _CELL,
            "arm.urdf": URDF,
            "plan.csv": _table(_PLACES),
            "targets.csv": _table(_PLACES[:2]),
        }
        _write(folder, texts)
        texts["data.csv"] = _data(folder)
        _write(folder, texts)
        results = {own: _result(folder, line, own) for own, _, line in _COMMANDS}
        return texts, results


def _result(folder: Path, line: str, own: str) -> dict[str, Any]:
    """What a command writes; its inputs are named as they stand beside it, whatever the folder."""
    files = ("csv", "toml", "json", ".")
    words = [str(folder / w) if w.endswith(files) else w for w in line.split()]
    file = folder / f"{own}.json"
    done = CliRunner().invoke(main, [*words, "--json", str(file)])
    if done.exit_code:
        raise RuntimeError(done.output)
    fields: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    for entry in fields["inputs"]:
        entry["file"] = Path(entry["file"]).name
    return fields


def _data(folder: Path) -> str:
    """Measurements of a robot whose slide is longer than its model says, one marker hidden once."""
    cell, rng = load_cell(folder / "cell.toml"), np.random.default_rng(1)
    poses = load_plan(cell, folder / "plan.csv")
    model = build(replace(cell, effects=(*cell.effects, "transmission_scale:X1")), poses).model
    data = drawn_readings(
        model, rng.normal(size=len(model.parameters)) * model.sizes, poses, cell.noise, rng
    )
    data.seen[1, 1] = False
    return measurements_csv(cell, data)


def _write(folder: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def put_small_cell(folder: Path) -> None:
    """The cell's files, unless they are there."""
    if not (folder / "data.csv").exists() or (folder / "cell.toml").stat().st_size != len(_CELL):
        _write(folder, _made()[0])


def small_results() -> dict[str, Any]:
    """Result of each command."""
    return _made()[1]
