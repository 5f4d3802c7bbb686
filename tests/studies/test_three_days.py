"""Three days of a stranger, from the robot's file to the page, by the README's commands alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from studies.cli import main
from tests.studies.three_arms import (
    joints_of,
    measured,
    moved,
    real_arm,
    scara,
    scara_dh,
    seven,
    seven_mjcf,
    ur5e,
    ur5e_urdf,
)

SCARA_EDIT = (
    "[robot.limits_deg]\nJ1 = [-132, 132]\nJ2 = [-141, 141]\n[robot.limits_mm]\nJ3 = [0, 200]\n"
)
DAYS = [  # file, its text, edit of the cell, the truth, its cause, a target's range of joints
    ("ur5e.urdf", ur5e_urdf, "", ur5e, "transmission_harmonic:elbow", [(-1.5, 1.5)] * 6),
    ("scara.csv", scara_dh, SCARA_EDIT, scara, "backlash:J2", [(-2, 2)] * 2 + [(0, 0.15), (-2, 2)]),
    ("seven.xml", seven_mjcf, "", seven, "joint_compliance:A2", [(-1.5, 1.5)] * 7),
]


def run(*arguments: object) -> str:
    done = CliRunner().invoke(main, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    return done.output


def result(file: Path) -> Any:
    return json.loads(file.read_text())


def commanded(columns: list[str], spans: list[tuple[float, float]]) -> str:
    """Eight targets within a box, as the table of a job."""
    low, high = np.array(spans).T
    q = np.random.default_rng(9).uniform(low, high, (8, len(low)))
    shown = q / [np.pi / 180 if c.endswith("_deg") else 1e-3 for c in columns]
    rows = (f"t{k}," + ",".join(f"{v:.6f}" for v in row) for k, row in enumerate(shown))
    return "\n".join([",".join(["pose", *columns]), *rows, ""])


def rms(difference: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=-1))))


@pytest.mark.long
@pytest.mark.parametrize(("file", "text", "edit", "tip", "cause", "spans"), DAYS)
def test_a_day(
    file: str,
    text: Callable[[], str],
    edit: str,
    tip: Callable[..., Array],
    cause: str,
    spans: list[tuple[float, float]],
    tmp_path: Path,
) -> None:
    if file.endswith("xml"):
        pytest.importorskip("mujoco")
    real = real_arm(tip, seed=1)
    (tmp_path / file).write_text(text())
    cell, plan, table = (tmp_path / n for n in ("cell.toml", "plan.csv", "measurements.csv"))
    dh = ["--dh", "classic"] if file.endswith("csv") else []
    run("init", tmp_path / file, "-o", tmp_path, *dh)
    cell.write_text(cell.read_text().replace("poses = 30", "poses = 24"))
    if edit:
        cell.write_text(cell.read_text().replace("[markers_mm]", f"{edit}[markers_mm]", 1))

    criterion = "task" if file.endswith("xml") else "D"
    run("design", cell, "--criterion", criterion, "--candidates", 200, "-o", plan)
    _, columns, _ = joints_of(plan)
    assert "-0" not in plan.read_text().replace("\n", ",").split(",")
    table.write_text(measured(real, plan, seed=2))

    lacking = tmp_path / "lacking.json"
    run("identify", cell, table, "--holdout", 0.25, "--json", lacking)
    assert result(lacking)["rms_mm"]["heldout"] > 0.03  # the cause is seen where it was not fitted

    whole, diagnosed, found = (tmp_path / n for n in ("whole.toml", "diagnosed.json", "found.json"))
    run("diagnose", cell, table, "--holdout", 0.25, "--cell-out", whole, "--json", diagnosed)
    named = [f"{e['effect']}:{e['where']}" for e in result(diagnosed)["effects"]]
    assert named == [cause]
    run("identify", whole, table, "--json", found)

    targets, better, told = (tmp_path / n for n in ("targets.csv", "better.csv", "told.json"))
    targets.write_text(commanded(columns, spans))
    run("compensate", whole, found, targets, "-o", better, "--json", told)
    identified = result(found)
    turn = Rotation.from_rotvec(identified["base"]["rotation_vector_rad"])
    base = moved(np.array(identified["base"]["translation_mm"]) * 1e-3, turn)
    markers = np.array([identified["markers_mm"][m] for m in ("m1", "m2", "m3")]) * 1e-3
    wanted = real.nominal(markers, base).points(joints_of(targets)[2])
    before = rms(real.points(joints_of(targets)[2]) - wanted)
    after = rms(real.points(joints_of(better)[2]) - wanted)
    expected = result(told)["rms_mm"]
    assert before == pytest.approx(expected["before"] * 1e-3, rel=0.05)
    assert after < min(0.1 * before, 2.0 * expected["expected"] * 1e-3)

    page = tmp_path / "report.html"
    run("report", found, diagnosed, told, "-o", page)
    assert cause in page.read_text()
