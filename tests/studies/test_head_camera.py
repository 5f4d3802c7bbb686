"""The commands on a robot whose head watches its hand, one after the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calib
from calib.files.cell import load_cell
from calib.files.tables import load_plan
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from tests.studies.command_line import result, run
from tests.two_arms import COMMON, EYE, PLATE, written

EFFECTS = '"base", "tool", "joint_offset"'


def test_every_command_of_a_day(tmp_path: Path) -> None:
    path = written(tmp_path, PLATE, EYE, effects=EFFECTS)
    plan = tmp_path / "plan.csv"
    done = run(
        "design",
        within(tmp_path),
        "-o",
        plan,
        "--poses",
        30,
        "--candidates",
        1500,
        "--reapproach",
        0,
    )
    assert done.exit_code == 0, done.output
    table = tmp_path / "measurements.csv"
    truth = simulated(path, plan, table)

    found, told = result(tmp_path / "id.json", "identify", path, table, kind="identify")
    off = {p["id"]: abs(p["value"] - truth[p["id"]]) / p["std"] for p in found["parameters"]}
    assert max(off.values()) < 4.5
    (untold,) = found["unidentifiable"]
    assert untold["names"] == [f"joint_offset:{joint}.offset" for joint in COMMON]
    assert "they move nothing that is read against the instrument that reads it" in told

    targets = tmp_path / "targets.csv"
    targets.write_text("".join(plan.read_text().splitlines(keepends=True)[:9]))
    _, said = result(tmp_path / "c.json", "compensate", path, tmp_path / "id.json", targets)
    assert "no instrument saw an error of hip, bend" in said
    assert "commands are corrected for right_hand" in said

    report = run("report", tmp_path / "id.json", "-o", tmp_path / "report.html")
    assert report.exit_code == 0, report.output
    assert " on head" in (tmp_path / "report.html").read_text()

    urdf = tmp_path / "better.urdf"
    assert run("identify", path, table, "--urdf", urdf).exit_code == 0
    assert '"marker_plate:0"' in urdf.read_text()
    assert "marker_head" not in urdf.read_text()

    before = written(tmp_path, PLATE, EYE, effects='"base", "tool"')
    verdict, _ = result(tmp_path / "di.json", "diagnose", before, table, kind="diagnose")
    places = {own["where"] for own in verdict["effects"]} | {
        own["where"] for own in verdict["located"]
    }
    assert places
    assert not places & {*COMMON}


def within(folder: Path) -> Path:
    """The cell with an image that is 60 pixels less at each side, so that its plan keeps a reserve."""
    inner = EYE.replace("[1280, 960]", "[1160, 840]").replace("[640, 480]", "[580, 420]")
    (folder / "inner").mkdir()
    return written(folder / "inner", PLATE, inner, effects=EFFECTS)


def simulated(path: Path, plan: Path, table: Path) -> dict[str, float]:
    """Offsets of a tenth of a degree and more, read with the camera's noise; the truth as shown.

    Camera and board stand where they should to a millimetre: further off, most images of the plan
    are lost.
    """
    cell = load_cell(path)
    poses = load_plan(cell, plan)
    model = build(cell, poses).model
    draws = np.random.default_rng(3).normal(size=len(model.parameters))
    placed = [p.id.startswith(("base", "tool")) for p in model.parameters]
    values = model.initial + draws * model.sizes * np.where(placed, 0.1, 1.0)
    table.write_text(measurements_csv(cell, calib.simulate(cell, poses, values, rng=1)))
    shown = [value / p.scale for value, p in zip(values, model.parameters, strict=True)]
    return dict(zip((p.id for p in model.parameters), shown, strict=True))
