"""``posecal identify``: what it writes, what it says of drift and lenses, what robots' files hold."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import load_cell
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import fit_rigid
from calib.arrays import Array
from calib.files.cell_out import extended_cell
from calib.files.urdf import load_urdf
from studies.research.truth.day import Day, Setting, draw_day, write_day
from studies.research.truth.mechanism import Action
from tests.calib.test_trees import body_positions
from tests.studies.command_line import refused, result, run
from tests.trees import as_mjcf


@pytest.fixture(scope="module")
def fields(demo: Path) -> dict[str, Any]:
    return json.loads((demo / "result.json").read_text())


def test_result_holds_what_the_contract_names(fields: dict[str, Any]) -> None:
    assert (fields["schema"], fields["command"], fields["seed"]) == (1, "identify", 0)
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


def test_what_a_rigid_robot_cannot_hold_is_said(demo: Path) -> None:
    soft = "rigid, without stiffness_vs_angle:A2, joint_compliance:A3, joint_compliance:A4"
    assert soft in (demo / "said").read_text()


def test_json_to_standard_output_is_json_alone(small: Path) -> None:
    done = run("identify", small / "cell.toml", small / "data.csv", "--json", "-")
    assert json.loads(done.stdout)["status"] == "converged"
    assert "11 of 11 parameters" in done.stderr


def test_holdout_by_fraction_and_by_file(small: Path) -> None:
    cell, table = small / "cell.toml", small / "data.csv"

    def held(holdout: object, *more: object) -> dict[str, Any]:
        call = ("identify", cell, table, "--holdout", holdout, *more)
        return result(small / "out.json", *call)[0]

    first, other = held("0.3"), held("0.3", "--seed", 1)
    assert other["rms_mm"] != first["rms_mm"], "the seed decides"
    assert first["rms_mm"]["heldout"] > 0
    poses = {r["pose"] for r in other["residuals"] if r["heldout"]}
    assert poses == {"p0", "p6", "p7"}, "two configurations, one of them visited twice"
    copy = small / "copy.csv"
    copy.write_text(table.read_text())
    both = held(copy)
    assert both["rms_mm"]["heldout"] == pytest.approx(both["rms_mm"]["fitted"])
    named = [Path(entry["file"]).name for entry in both["inputs"]]
    assert named == ["cell.toml", "arm.urdf", "data.csv", "targets.csv", "copy.csv"]


@pytest.mark.parametrize(
    ("step", "again", "drifts"),
    [(0.0, True, False), (0.05, True, True), (0.05, False, None)],
    ids=["still", "drifting", "nothing repeated"],
)
@pytest.mark.parametrize("timed", [True, False], ids=["timed", "in order"])
def test_poses_read_again_tell_of_drift(
    step: float,
    again: bool,
    drifts: bool | None,
    timed: bool,
    small: Path,
    rng: np.random.Generator,
) -> None:
    """Those that are held out, too: p0 is read between all others; readings move step, mm, a pose."""
    cell, table = small / "cell.toml", small / "data.csv"
    header, *rows = (line.split(",") for line in table.read_text().splitlines())
    poses = [pose for k in range(1, 7) for pose in (["p0"] * (again or k == 1) + [f"p{k}"])]
    x, lines = header.index("x_mm"), [[*header, *["time_s"] * timed]]
    for k, pose in enumerate(poses):
        for row in (own for own in rows if own[0] == pose):
            point = np.array(row[x:], dtype=float) + rng.normal(scale=0.01, size=3)
            point[0] += step * k
            lines.append([f"{pose}_{k}", *row[1:x], *map(str, point), *[str(300 * k)] * timed])
    table.write_text("\n".join(map(",".join, lines)))
    call = ("identify", cell, table, "--holdout", "0.3", "--seed", 1)
    fields, said = result(small / "out.json", *call)
    assert "p0_0" in {row["pose"] for row in fields["residuals"] if row["heldout"]}
    assert (fields["drift_p"] is None) == (drifts is None)
    assert drifts is None or (fields["drift_p"] < 0.01) == drifts
    assert ("poses read again moved steadily" in said) == bool(drifts)
    assert ("Put base_drift into" in said) == bool(drifts)


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


# -- The robot's file that is written, as MuJoCo moves it


@dataclass(frozen=True)
class Written:
    """A day of an arm that is off everywhere, and the folder of what ``identify`` writes of it."""

    day: Day
    folder: Path
    said: str

    @property
    def call(self) -> tuple[object, ...]:
        return "identify", self.folder / "cell.toml", self.folder / "measurements.csv"

    def at(self, *links: str) -> Array:
        """Where MuJoCo has links of the corrected file at the targets, shape (T, links, 3), m."""
        text = (self.folder / "found.urdf").read_text()
        return body_positions(text, links, self.day.targets)


def identified_day(folder: Path, *more: tuple[str, str]) -> Written:
    """The day identified; more : what is replaced in the cell before."""
    day = draw_day(Setting("6R", 1e-9, 1, 60, 3), 0, 5)
    write_day(folder, day)
    (folder / "model").mkdir()
    arm = as_mjcf((folder / "robot.urdf").read_text())
    (folder / "model" / "arm.xml").write_text(arm)
    (folder / "model" / "scene.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    cell = folder / "cell.toml"
    for old, new in more:
        cell.write_text(cell.read_text().replace(old, new))
    made = Written(day, folder, "")
    written = ("--urdf", folder / "found.urdf", "--zero-offsets", folder / "zeros.csv")
    _, said = result(folder / "result.json", *made.call, *written)
    return Written(day, folder, said)


MJCF = ('urdf = "robot.urdf"', 'mjcf = "model/scene.xml"')


@pytest.fixture(scope="module")
def of_urdf(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return identified_day(tmp_path_factory.mktemp("urdf"))


@pytest.fixture(scope="module")
def of_mjcf(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return identified_day(tmp_path_factory.mktemp("mjcf"), MJCF)


def best_placed(points: Array, true: Array) -> tuple[Array, Array, float]:
    """R (3, 3) and p (3,) that bring points (.., 3) nearest to true ones, and the RMS distance left."""
    T = fit_rigid(true.reshape(-1, 3), points.reshape(-1, 3))
    R, p = T[:3, :3], T[:3, 3]
    return R, p, float(np.sqrt(((points @ R.T + p - true) ** 2).sum(-1).mean()))


def on_tip(robot: Robot, markers: Array, q: Array) -> Array:
    """Markers (M, 3) of the tip at joints (N, n), shape (N, M, 3), m."""
    frames = forward(robot, q)
    return np.asarray(markers @ np.swapaxes(frames.R[:, -1], -1, -2) + frames.o[:, -1:])


@pytest.mark.parametrize("form", ["of_urdf", "of_mjcf"])
def test_the_file_predicts_markers_at_new_poses_and_not_the_flange(
    form: str, request: pytest.FixtureRequest
) -> None:
    written: Written = request.getfixturevalue(form)
    told = (
        "only the markers (m1, m2, m3) are calibrated. The readings do not show where flange sits"
    )
    assert told in written.said
    text = (written.folder / "found.urdf").read_text()
    assert re.search(r"<!-- only the markers .* are calibrated\. .* where flange sits", text)
    day, q = written.day, written.day.targets
    R, p, left = best_placed(written.at("marker_m1", "marker_m2", "marker_m3"), day.reached)
    assert left < 0.03e-3
    nominal = load_cell(written.folder / "cell.toml")
    before = best_placed(on_tip(nominal.robot, nominal.markers, q), day.reached)[2]
    assert before > 1e-3 > 30 * left
    still = Action.none(day.arm, len(q), 3)
    true = day.mechanism.rest(q, lambda _: still, (day.R, day.p)).o[:, -1] @ day.R.T + day.p
    flange = written.at("flange")[:, 0] @ R.T + p - true
    assert np.sqrt((flange**2).sum(-1).mean()) > 0.3e-3


def test_an_mjcf_is_named_by_all_its_files_kept_and_found_from_elsewhere(
    of_mjcf: Written, tmp_path: Path
) -> None:
    assert "found.urdf is made anew from the MJCF: the bare chain, without" in of_mjcf.said
    fields = json.loads((of_mjcf.folder / "result.json").read_text())
    names = [Path(entry["file"]).name for entry in fields["inputs"]]
    assert names == ["cell.toml", "scene.xml", "arm.xml", "measurements.csv", "targets.csv"]
    arm = of_mjcf.folder / "model" / "arm.xml"
    before = arm.read_text()
    assert "arm.xml: is already an input" in refused(*of_mjcf.call, "--urdf", arm)
    assert arm.read_text() == before
    cell = load_cell(of_mjcf.folder / "cell.toml")
    poses = calib.load_measurements(cell, of_mjcf.folder / "measurements.csv").poses
    target = tmp_path / "cell.toml"
    target.write_text(extended_cell(cell, [], poses, target).text)
    again = load_cell(target)
    assert [f.resolve() for f in again.robot_files] == [f.resolve() for f in cell.robot_files]


def test_corrected_urdf_is_the_nominal_model_of_the_next_run(of_urdf: Written) -> None:
    """The geometry that is left is within its uncertainty, and can be corrected again."""
    folder = of_urdf.folder
    text = (folder / "cell.toml").read_text().replace("robot.urdf", "found.urdf")
    (folder / "next.toml").write_text(text)
    call = ("identify", folder / "next.toml", folder / "measurements.csv")
    fields, _ = result(folder / "next.json", *call, "--urdf", folder / "again.urdf")
    left = [p for p in fields["parameters"] if p["effect"] == "geometry"]
    assert max(abs(p["value"]) / p["std"] for p in left) < 0.05
    assert (folder / "again.urdf").read_text().count('link name="marker_m1"') == 1


def test_known_markers_leave_nothing_to_say(tmp_path: Path) -> None:
    known = identified_day(tmp_path, ('"base", "tool"', '"base"'))
    assert "only the markers" not in known.said + (tmp_path / "found.urdf").read_text()


def test_zero_offsets_are_the_part_along_the_axes(of_urdf: Written) -> None:
    rows = [*csv.DictReader((of_urdf.folder / "zeros.csv").read_text().splitlines())]
    cell, q = load_cell(of_urdf.folder / "cell.toml"), of_urdf.day.targets
    assert [(row["joint"], row["unit"]) for row in rows] == [(j, "deg") for j in cell.robot.joints]
    assert all(float(row["reads_at_zero"]) == -float(row["offset"]) for row in rows)
    pattern = r"geometry found, ([\d.]+) mm at the markers, ([\d.]+) mm stay"
    said = re.search(pattern, of_urdf.said)
    assert said is not None
    assert 0.0 < float(said[2]) < float(said[1])
    found = load_urdf(of_urdf.folder / "found.urdf", "base", "flange")
    goal = on_tip(found, cell.markers, q)
    shifted = q + np.radians([float(row["offset"]) for row in rows])
    for words, moved in ((said[1], q), (said[2], shifted)):
        left = best_placed(on_tip(cell.robot, cell.markers, moved), goal)[2]
        assert float(words) == pytest.approx(left * 1e3, rel=0.3), "other poses, other markers"
