"""``posecal identify``: what it writes, what it says of drift and lenses, what robots' files hold."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import load_cell, load_plan, readings
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.statics import wrench_with_load
from calib.arrays import Array
from calib.files.urdf import load_urdf
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from studies.research.truth.day import Day, Setting, draw_day, write_day
from studies.research.truth.mechanism import Action
from tests.studies.command_line import paper_cell, result, run


@pytest.fixture(scope="module")
def fields(demo: Path) -> dict[str, Any]:
    return json.loads((demo / "result.json").read_text())


def test_result_holds_what_the_contract_names(demo: Path, fields: dict[str, Any]) -> None:
    assert fields["schema"] == 1
    assert fields["command"] == "identify"
    assert fields["seed"] == 0
    for entry in fields["inputs"]:
        assert entry["sha256"] == hashlib.sha256(Path(entry["file"]).read_bytes()).hexdigest()
    assert fields["status"] == "converged"
    assert fields["rank"] == len(fields["parameters"]) == 42
    assert {"sigma_mm", "believed_sigma_mm", "source"} <= set(fields["noise"])
    assert {"name", "effect", "where", "value", "std", "unit"} <= set(fields["parameters"][0])
    keys = {"nominal", "fitted", "fitted_all", "heldout", "heldout_trimmed"}
    for name in ("rms_mm", "max_mm", "p95_mm"):
        assert set(fields[name]) == keys
        assert fields[name]["heldout"] is None
    assert len(fields["residuals"]) == 90
    knots = [p["name"] for p in fields["parameters"] if p["effect"] == "stiffness_vs_angle"]
    assert knots[0] == "compliance@-140"


def test_base_and_markers_predict_the_readings(demo: Path, fields: dict[str, Any]) -> None:
    """The parameters of the JSON, in SI, are the values that ``calib.predict`` takes."""
    cell = calib.load_cell(demo / "cell.toml")
    data = calib.load_measurements(cell, demo / "measurements.csv")
    scale = {"mm": 1e-3, "mrad": 1e-3, "um": 1e-6, "urad": 1e-6, "urad/(N m)": 1e-6}
    values = {p["id"]: p["value"] * scale[p["unit"]] for p in fields["parameters"]}
    error = data.points - calib.predict(cell, data, values)
    rms = 1e3 * math.sqrt(np.mean(np.sum(error**2, axis=-1)))
    assert rms == pytest.approx(fields["rms_mm"]["fitted"], rel=1e-6)
    residuals = np.array([[r["x_mm"], r["y_mm"], r["z_mm"]] for r in fields["residuals"]])
    np.testing.assert_allclose(error.reshape(-1, 3) * 1e3, residuals, atol=1e-6)
    translation = [values[f"base:base.{c}"] * 1e3 for c in "xyz"]
    np.testing.assert_allclose(fields["base"]["translation_mm"], translation)


def test_json_to_standard_output_is_json_alone(demo: Path) -> None:
    done = run("identify", demo / "cell.toml", demo / "measurements.csv", "--json", "-")
    assert json.loads(done.stdout)["status"] == "converged"
    assert "42 of 42 parameters" in done.stderr


def test_holdout_by_fraction_and_by_file(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.json"
    cell, table = demo / "cell.toml", demo / "measurements.csv"
    assert run("identify", cell, table, "--holdout", "0.2", "--json", out).exit_code == 0
    first = json.loads(out.read_text())
    assert first["rms_mm"]["heldout"] > 0
    assert sum(r["heldout"] for r in first["residuals"]) == 3 * 2 * 3
    run("identify", cell, table, "--holdout", "0.2", "--seed", "5", "--json", out)
    assert json.loads(out.read_text())["rms_mm"] != first["rms_mm"], "the seed decides"
    assert "holds the data themselves" in run("identify", cell, table, "--holdout", table).stderr
    copy = tmp_path / "copy.csv"
    copy.write_text(table.read_text())
    assert run("identify", cell, table, "--holdout", copy, "--json", out).exit_code == 0
    both = json.loads(out.read_text())
    assert both["rms_mm"]["heldout"] == pytest.approx(both["rms_mm"]["fitted"])
    assert len(both["inputs"]) == 4


def test_corrected_urdf_is_the_nominal_model_of_the_next_run(demo: Path, tmp_path: Path) -> None:
    """The geometry that is left is within its uncertainty, and can be corrected again."""
    (tmp_path / "kr270.urdf").write_text((demo / "kr270_calibrated.urdf").read_text())
    (tmp_path / "cell.toml").write_text((demo / "cell.toml").read_text())
    out, urdf = tmp_path / "r.json", tmp_path / "again.urdf"
    cell, table = tmp_path / "cell.toml", demo / "measurements.csv"
    done = run("identify", cell, table, "--json", out, "--urdf", urdf)
    assert done.exit_code == 0, done.output
    again = json.loads(out.read_text())
    left = [p for p in again["parameters"] if p["effect"] == "geometry"]
    assert max(abs(p["value"]) / p["std"] for p in left) < 0.05
    assert urdf.read_text().count('link name="marker_m1"') == 1


RATES = np.array([40.0, -60.0, 20.0, 20.0, 0.0, -30.0])  # um/h and urad/h


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's plan with its first pose again at the start, in the middle and at the end."""
    path = tmp_path_factory.mktemp("day")
    paper_cell(path, "base", "tool", "joint_compliance:A2,A3,A4,A5,A6")
    header, *rows = (path / "plan.csv").read_text().splitlines()
    again = [rows[0].replace("p01", f"ref{k}", 1) for k in (1, 2, 3, 4)]
    assert all(row.startswith("ref") for row in again)
    plan = [again[0], *rows[1:6], again[1], *rows[6:11], again[2], *rows[11:], again[3]]
    (path / "plan.csv").write_text("\n".join([header, *plan]) + "\n")
    return path


def measured(folder: Path, rates: np.ndarray, timed: bool = True) -> Path:
    cell = load_cell(folder / "cell.toml")
    poses = readings(cell, load_plan(cell, folder / "plan.csv"))
    poses = replace(
        poses,
        wrench=wrench_with_load(cell.robot, cell.gravity, poses),
        load_mass=np.zeros(len(poses)),
        time=300.0 * np.arange(len(poses)),
    )
    model = build(replace(cell, effects=(*cell.effects, "base_drift")), with_moves(poses)).model
    values = np.zeros(len(model.parameters))
    values[-6:] = rates * 1e-6 / 3600.0
    values[model.where(type(model.effects[4]))] = 1e-6
    data = drawn_readings(model, values, poses, cell.noise, np.random.default_rng(0))
    data = replace(data, poses=replace(data.poses, approach=None))
    if not timed:
        data = replace(data, poses=replace(data.poses, time=None))
    path = folder / "measured.csv"
    path.write_text(measurements_csv(cell, data))
    return path


def identified(folder: Path, data: Path, *more: object) -> tuple[float | None, str]:
    out = folder / "result.json"
    fields, said = result(out, "identify", folder / "cell.toml", data, *more)
    return fields["drift_p"], said


def test_a_still_day(folder: Path) -> None:
    p, said = identified(folder, measured(folder, 0.0 * RATES))
    assert p is not None
    assert p > 0.01
    assert "base_drift" not in said


@pytest.mark.parametrize("timed", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_drifting_day(folder: Path, timed: bool) -> None:
    """Poses that are held out tell of it as those that are fitted."""
    p, said = identified(folder, measured(folder, RATES, timed), "--holdout", "0.3")
    assert p is not None
    assert p < 0.01
    assert "poses read again moved steadily" in " ".join(said.split())
    assert "base_drift" in said


def test_nothing_repeated_says_nothing(folder: Path) -> None:
    data = measured(folder, RATES)
    kept = [
        line
        for line in data.read_text().splitlines()
        if not line.startswith(("ref2", "ref3", "ref4"))
    ]
    data.write_text("\n".join(kept))
    p, said = identified(folder, data)
    assert p is None
    assert "read again" not in said


@pytest.mark.parametrize(
    ("more", "effects"),
    [pytest.param('free = ["focal", "center", "distortion"]\n', "", marks=pytest.mark.long),
     ("", ', "focal", "principal_point", "distortion"')],
    ids=["free", "effects"],
)  # fmt: skip
def test_a_wrong_lens_is_found(more: str, effects: str, tmp_path: Path) -> None:
    cameras = pytest.importorskip("tests.camera_days")
    lens = np.add(cameras.LENS, [6.0, 4.0, 3.5, -3.0, -0.03, 0.01, 0.0, 0.0, 0.0])
    day = cameras.SETUPS["kr270, hand"], cameras.Truth(np.zeros(6), lens)
    effects = f'"base", "tool", "geometry"{effects}'
    cell, _ = cameras.kr270_day(tmp_path, *day, 45, effects=effects, more=more)
    call = ("identify", cell.path, tmp_path / "measurements.csv")
    fields, _ = result(tmp_path / "i.json", *call)
    rows = {row["name"]: row for row in fields["lenses"]}
    assert list(rows) == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
    for (name, row), value in zip(rows.items(), lens, strict=True):
        assert abs(row["value"] - value) < 4.0 * row["std"], name


@dataclass(frozen=True)
class Written:
    """A day of an arm that is off everywhere, and the folder of what ``identify`` writes of it."""

    day: Day
    folder: Path
    said: str

    def at_link(self, link: str, q: Array) -> Array:
        """The origin of a link of the corrected file at joints (N, n), shape (N, 3), m."""
        robot = load_urdf(self.folder / "found.urdf", "base", link)
        return np.asarray(forward(robot, q).o[:, robot.tip_frame])

    def markers(self, q: Array) -> Array:
        """The markers of the corrected file, shape (N, 3, 3), m."""
        return np.stack([self.at_link(f"marker_m{j}", q) for j in (1, 2, 3)], axis=1)


def identified_day(folder: Path, *more: tuple[str, str]) -> Written:
    """The day identified; more : what is replaced in the cell before."""
    day = draw_day(Setting("6R", 1e-9, 1, 60, 3), 0, 5)
    write_day(folder, day)
    cell = folder / "cell.toml"
    for old, new in more:
        cell.write_text(cell.read_text().replace(old, new))
    done = run(
        "identify", cell, folder / "measurements.csv",
        "--urdf", folder / "found.urdf", "--zero-offsets", folder / "zeros.csv",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return Written(day, folder, " ".join(done.stdout.split()))


@pytest.fixture(scope="module")
def written_day(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return identified_day(tmp_path_factory.mktemp("day"))


def best_placed(points: Array, true: Array) -> tuple[Array, Array, float]:
    """R (3, 3) and p (3,) that bring points (.., 3) nearest to true ones, and the RMS distance left."""
    points, true = points.reshape(-1, 3), true.reshape(-1, 3)
    a, b = points - points.mean(0), true - true.mean(0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = (U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T
    left = float(np.sqrt(((a @ R.T - b) ** 2).sum(-1).mean()))
    return R, true.mean(0) - points.mean(0) @ R.T, left


def on_tip(robot: Robot, markers: Array, q: Array) -> Array:
    """Markers (M, 3) of the tip at joints (N, n), shape (N, M, 3), m."""
    frames = forward(robot, q)
    return np.asarray(markers @ np.swapaxes(frames.R[:, -1], -1, -2) + frames.o[:, -1:])


def test_the_file_predicts_markers_at_new_poses_and_not_the_flange(written_day: Written) -> None:
    said = (
        "only the markers (m1, m2, m3) are calibrated. The readings do not show where flange sits"
    )
    assert said in written_day.said
    text = (written_day.folder / "found.urdf").read_text()
    assert re.search(r"<!-- only the markers .* are calibrated\. .* where flange sits", text)
    day, q = written_day.day, written_day.day.targets
    R, p, left = best_placed(written_day.markers(q), day.reached)
    assert left < 0.03e-3
    nominal = load_cell(written_day.folder / "cell.toml")
    before = best_placed(on_tip(nominal.robot, nominal.markers, q), day.reached)[2]
    assert before > 1e-3 > 30 * left
    still = Action.none(day.arm, len(q), 3)
    true = day.mechanism.rest(q, lambda _: still, (day.R, day.p)).o[:, -1] @ day.R.T + day.p
    flange = written_day.at_link("flange", q) @ R.T + p - true
    assert np.sqrt((flange**2).sum(-1).mean()) > 0.3e-3


def test_known_markers_leave_nothing_to_say(tmp_path: Path) -> None:
    known = identified_day(tmp_path, ('"base", "tool"', '"base"'))
    assert "only the markers" not in known.said + (tmp_path / "found.urdf").read_text()


def test_zero_offsets_are_the_part_along_the_axes(written_day: Written) -> None:
    rows = [*csv.DictReader((written_day.folder / "zeros.csv").read_text().splitlines())]
    cell, q = load_cell(written_day.folder / "cell.toml"), written_day.day.targets
    assert [(row["joint"], row["unit"]) for row in rows] == [(j, "deg") for j in cell.robot.joints]
    assert all(float(row["reads_at_zero"]) == -float(row["offset"]) for row in rows)
    pattern = r"geometry found, ([\d.]+) mm at the markers, ([\d.]+) mm stay"
    said = re.search(pattern, written_day.said)
    assert said is not None
    assert 0.0 < float(said[2]) < float(said[1])
    found = load_urdf(written_day.folder / "found.urdf", "base", "flange")
    goal = on_tip(found, cell.markers, q)
    shifted = q + np.radians([float(row["offset"]) for row in rows])
    for words, moved in ((said[1], q), (said[2], shifted)):
        left = best_placed(on_tip(cell.robot, cell.markers, moved), goal)[2]
        assert float(words) == pytest.approx(left * 1e3, rel=0.3), "other poses, other markers"
