"""Commands as a user and an outside check see them: design, import, program, enough, changes."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import calib
from calib.errors import InputError
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from doe.criteria import CRITERIA, UNASKED
from studies.command.program import MOST_AXES, program_text
from studies.demo.embedded import embedded_text
from tests.calib.test_motion import arm
from tests.camera_cells import PINHOLE, camera_cell
from tests.day import PLAN_MODEL, of_poses, whole_day
from tests.helpers import cell_of, random_robot, simulated
from tests.studies.command_line import paper_cell, result, run
from tests.studies.test_texts import blocks

OPTIONS = ("--candidates", 2000, "--levels", "A2=-140,-99.85,-56.9,-25.24,-0.01x3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell with its elastostatic model."""
    path = tmp_path_factory.mktemp("cell")
    paper_cell(path, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
    return path


@pytest.fixture(scope="module")
def done(folder: Path) -> Result:
    return run(
        "design", folder / "cell.toml", *OPTIONS, "--against", folder / "plan.csv", "--curve",
        "-o", folder / "best.csv", "--json", folder / "best.json",
    )  # fmt: skip


@pytest.fixture(scope="module")
def fields(folder: Path, done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.output
    return json.loads((folder / "best.json").read_text(), parse_constant=pytest.fail)


@pytest.mark.long
def test_plan_is_read_by_the_other_commands(folder: Path, fields: dict[str, Any]) -> None:
    cell = calib.load_cell(folder / "cell.toml")
    plan = calib.load_plan(cell, folder / "best.csv")
    assert plan.names == tuple(pose["pose"] for pose in fields["poses"])
    shown = [list(pose["joints_deg"].values()) for pose in fields["poses"]]
    np.testing.assert_allclose(np.degrees(plan.q), shown, atol=1e-9)
    with (folder / "best.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["level"]) for row in rows] == [pose["level"] for pose in fields["poses"]]
    assert all(re.fullmatch(r"-?\d+(\.\d{1,2})?", row["A4_deg"]) for row in rows)


@pytest.mark.long
def test_tables_say_what_matters(done: Result) -> None:
    text = " ".join(done.output.split())
    for said in (
        "15 poses. Expected error at the targets",
        "Taken for granted: a model that lacks nothing, an arm that repeats exactly; 200 poses spread",
        "no plan is below",
        "plan.csv",
        "9 parameters",
    ):
        assert said in text, said
    assert "nan" not in text.lower()
    assert max(len(line) for line in done.output.splitlines() if "wrote" not in line) <= 110


@pytest.mark.long
def test_a_plan_found_is_its_own_equal(folder: Path, fields: dict[str, Any]) -> None:
    """Judged beside a new design of the same candidates it has the value it was given.

    Of two plans of one name both are judged.
    """
    (folder / "other").mkdir(exist_ok=True)
    (folder / "other" / "plan.csv").write_text((folder / "plan.csv").read_text())
    plans = [folder / "best.csv", folder / "plan.csv", folder / "other" / "plan.csv"]
    flags = [word for plan in plans for word in ("--against", plan)]
    found = run("design", folder / "cell.toml", *OPTIONS, *flags, "--json", "-")
    again = json.loads(found.stdout)
    rival = again["against"][str(folder / "best.csv")]
    assert rival["value"] == pytest.approx(fields["value"], rel=1e-6)
    assert rival["efficiency"] <= 1.0
    assert again["value"] == pytest.approx(fields["value"], rel=1e-12)
    assert set(again["against"]) == {str(plan) for plan in plans}


@pytest.mark.long
def test_result_holds_what_the_contract_names(folder: Path, fields: dict[str, Any]) -> None:
    assert (fields["schema"], fields["command"], fields["seed"]) == (1, "design", 0)
    named = {Path(entry["file"]).name: entry["sha256"] for entry in fields["inputs"]}
    assert set(named) == {"cell.toml", "kr270.urdf", "plan.csv"}
    assert named["plan.csv"] == hashlib.sha256((folder / "plan.csv").read_bytes()).hexdigest()
    assert fields["criterion"] == "task"
    assert fields["value"] >= fields["bound"] > 0.0
    assert fields["efficiency"] == pytest.approx((fields["bound"] / fields["value"]) ** 2)
    assert fields["value"] == pytest.approx(fields["task_rms_mm"], rel=1e-5)
    assert len(fields["poses"]) == 15
    for pose in fields["poses"]:
        assert set(pose["joints_deg"]) == {f"A{k}" for k in range(1, 7)}
        assert pose["level"] == pytest.approx(pose["joints_deg"]["A2"])
    assert fields["levels_deg"] == {"A2": [-140.0, -99.85, -56.9, -25.24, -0.01]}
    assert [p["name"] for p in fields["predicted_std"]][:2] == [
        "compliance@-140",
        "compliance@-99.85",
    ]
    assert all(p["unit"] == "urad/(N m)" and p["std"] > 0 for p in fields["predicted_std"])
    candidates = fields["candidates"]
    assert candidates["drawn"] == candidates["feasible"] == 2000
    assert fields["seconds"] > 0.0
    assert fields["against"]["plan.csv"]["poses"] == 15
    assert [step["poses"] for step in fields["curve"]] == [5, 10, 15, 20, 25, 30]


def test_help_names_every_criterion() -> None:
    shown = run("design", "--help").output
    _, described = shown.split("--criterion NAME")
    words = re.findall(r"[\w-]+(?=:)", described.split("--levels")[0])
    assert set(CRITERIA) - {UNASKED} <= set(words)


@pytest.fixture(scope="module")
def half_day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("half")
    cell = calib.load_cell(paper_cell(path, *PLAN_MODEL))
    plan = calib.load_plan(cell, path / "plan.csv")
    data = of_poses(whole_day(cell, plan), [2, 5, 8, 11, 14, 1], 15)
    (path / "half.csv").write_text(measurements_csv(cell, data))
    return path


def asked(half_day: Path, *more: object) -> tuple[dict[str, Any], str]:
    call = ("enough", half_day / "cell.toml", half_day / "half.csv", *more)
    return result(half_day / "out.json", *call, kind="enough")


@pytest.mark.long
def test_it_names_the_poses_that_the_goal_needs_or_how_many_more(half_day: Path) -> None:
    plan = ("--plan", half_day / "plan.csv")
    now, _ = asked(half_day, *plan)
    assert now["plan"] == {"poses": 15, "measured": 6, "to_measure": 9}
    goal = now["order"][2]["task_most_mm"] * 1.0001
    fields, said = asked(half_day, *plan, "--goal-mm", goal)
    names = ", ".join(step["pose"] for step in fields["order"][:3])
    assert fields["poses_to_goal"] == 3
    assert f"after 3 more: {names}" in said
    assert {Path(entry["file"]).name for entry in fields["inputs"]} == {
        "cell.toml", "kr270.urdf", "half.csv", "plan.csv",
    }  # fmt: skip
    assert all(p["std"] > 0.0 for p in fields["end"]["parameters"])
    _, said = asked(half_day, *plan, "--goal-mm", 5)
    assert "You may stop." in said
    fields, said = asked(half_day, *plan, "--goal-mm", 0.97 * now["end"]["task_most_mm"])
    assert fields["poses_to_goal"] is None
    assert f"--poses {fields['fresh_poses_to_goal']}" in said


SLIP = 3e-4


@pytest.fixture(scope="module")
def months(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """May and June of one robot, of which the belt of A3 slipped in between, and of July nothing."""
    path = tmp_path_factory.mktemp("months")
    cell = calib.load_cell(paper_cell(path, "base", "tool", "joint_offset"))
    low, high = cell.robot.sample_limits().T
    for seed, month in enumerate(("may", "june", "july")):
        rng = np.random.default_rng(seed)
        poses = poses_at(rng.uniform(low, high, (25, 6)))
        model = build(cell, poses).model
        truth = np.zeros(len(model.parameters))
        truth[:6] = [2.0, -1.0, 0.3, 0.1, -0.2, 0.5]
        slipped = [p.id for p in model.parameters].index("joint_offset:A3.offset")
        truth[slipped] = 1e-3 + SLIP * (month == "june")
        data = drawn_readings(model, truth, poses, cell.noise, rng)
        (path / f"{month}.csv").write_text(measurements_csv(cell, data))
        done = run("identify", path / "cell.toml", path / f"{month}.csv", "--json",
                   path / f"{month}.json")  # fmt: skip
        assert done.exit_code == 0, done.output
    return path


def compared_months(
    months: Path, before: str, after: str, *more: object
) -> tuple[dict[str, Any], str]:
    call = ("changes", months / before, months / after, *more)
    return result(months / "out.json", *call, kind="changes")


def test_a_slipped_belt_is_told_with_what_it_does(months: Path) -> None:
    fields, said = compared_months(months, "may.json", "june.json", "--tolerance-mm", 0.1)
    assert fields["status"] == "changed"
    (moved,) = [p for p in fields["parameters"] if p["moved"]]
    assert moved["id"] == "joint_offset:A3.offset"
    assert moved["change"] == pytest.approx(SLIP * 1e6, rel=0.05)
    assert fields["verdict"] == "does_not"
    assert fields["kept_worst_mm"]["low"] > 0.1
    assert "may.json does not hold within 0.1 mm: worst target" in said
    assert "Moved: joint_offset:A3.offset" in said
    assert [Path(i["file"]).name for i in fields["inputs"]] == [
        "cell.toml", "kr270.urdf", "may.json", "june.json",
    ]  # fmt: skip


def test_a_robot_that_stayed_still_holds(months: Path) -> None:
    fields, said = compared_months(months, "may.json", "july.json", "--tolerance-mm", 0.1)
    assert (fields["status"], fields["verdict"]) == ("unchanged", "holds")
    assert "Nothing moved between may.json and july.json" in said
    assert "would go unnoticed" in said
    worst = fields["kept_worst_mm"]
    between = (worst["low"] + worst["high"]) / 2.0
    assert worst["low"] < between < worst["high"] < 0.1
    tight, _ = compared_months(months, "may.json", "july.json", "--tolerance-mm", between)
    assert tight["verdict"] == "cannot_be_said"
    free, _ = compared_months(months, "may.json", "july.json")
    assert free["verdict"] is None


def test_a_cell_that_changed(months: Path, tmp_path: Path) -> None:
    for name in ("may.json", "june.json", "kr270.urdf", "cell.toml"):
        shutil.copy(months / name, tmp_path / name)
    moved = {}
    for month in ("may", "june"):
        fields = json.loads((months / f"{month}.json").read_text())
        for entry in fields["inputs"]:
            entry["file"] = Path(entry["file"]).name
        (tmp_path / f"{month}.json").write_text(json.dumps(fields))
        moved[month] = tmp_path / f"{month}.json"
    done = run("changes", moved["may"], moved["june"])
    assert done.exit_code == 0, done.output
    assert "joint_offset:A3.offset" in done.output
    text = (tmp_path / "cell.toml").read_text()
    (tmp_path / "cell.toml").write_text(text + "\n# later\n")
    done = run("changes", moved["may"], moved["june"])
    assert done.exit_code == 2
    assert "cell.toml is changed since; give it with --cell" in done.stderr
    done = run("changes", moved["may"], moved["june"], "--cell", tmp_path / "cell.toml")
    assert done.exit_code == 0, done.output


EVIL = 'p"); halt() PTP {A1 0}; $OV_PRO=100 \\" &<>#\nHALT\r\nPTP {A1 0}\u2028\x7f\x1b[2J'

TARGET = {  # a line that drives, and the size of its numbers
    ".src": (r"^PTP \{(.*)\}$", np.pi / 180),
    ".script": (r"^  movej\(\[([^]]*)\]", 1.0),
    ".mod": (r"^    MoveAbsJ \[\[([^]]*)\],\[9E9", np.pi / 180),
    ".ls": (r"UT : 1,\n([^}]*)\n\};", np.pi / 180),
}


@pytest.mark.parametrize("ending", MOST_AXES)
def test_program_holds_the_plan(ending: str, tmp_path: Path) -> None:
    path = paper_cell(tmp_path)
    made = tmp_path / f"p{ending}"
    done = run("program", path, tmp_path / "plan.csv", "-o", made, "--json", tmp_path / "p.json")
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(path)
    plan, text = calib.load_plan(cell, tmp_path / "plan.csv"), made.read_text()
    pattern, size = TARGET[ending]
    found = [re.findall(r"-?\d+\.\d+", own) for own in re.findall(pattern, text, flags=re.M)]
    np.testing.assert_allclose(size * np.array(found, float), plan.q, rtol=0, atol=1e-8)
    fields = json.loads((tmp_path / "p.json").read_text(), parse_constant=pytest.fail)
    assert fields["poses"] == list(plan.names)
    waits = len(re.findall(r"^HALT$|^  popup\(|^    Stop;$|^ *\d+:  PAUSE ;$", text, flags=re.M))
    assert waits == fields["stops"] == 2 * len(plan)  # free, and with the cell's load
    evil = replace(plan, names=(EVIL, *plan.names[1:]))
    plain, other = (program_text(ending, "p", cell, own, "plan.csv", []) for own in (plan, evil))
    assert other.isascii()
    code = [re.sub(r'"[^"]*"|[;#!] ?[A-Za-z].*', "", own).splitlines() for own in (plain, other)]
    if ending != ".ls":  # whose remarks are broken into lines
        assert other != plain
        assert code[0] == code[1]


@pytest.mark.parametrize("ending", MOST_AXES)
def test_chains_that_a_language_has_no_axes_for(ending: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rail = cell_of(random_robot(rng, 7, prismatic=[6]), np.zeros((1, 3)), ())
    plan = calib.load_plan(cell := calib.load_cell(paper_cell(tmp_path)), tmp_path / "plan.csv")
    if ending != ".script":
        longer = replace(plan, q=np.c_[0.0 * plan.q, np.full(len(plan), 0.25)])
        free = replace(rail.robot, limits=np.full((7, 2), [-9.0, 9.0]))
        assert "250.000000" in program_text(
            ending, "2", replace(rail, robot=free), longer, "plan.csv", []
        )
    for robot in (random_robot(rng, 5), random_robot(rng, 13), random_robot(rng, 6, prismatic=[0])):
        with pytest.raises(InputError, match="takes six joints that turn"):
            program_text(ending, "p", replace(rail, robot=robot), plan, "plan.csv", [])
    beyond = replace(plan, q=plan.q + 10.0)
    with pytest.raises(InputError, match="joint A1 is beyond its limits; take the pose out"):
        program_text(ending, "p", cell, beyond, "plan.csv", [])


@pytest.fixture(scope="module")
def two_tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell, simulated measurements, and the same as a table of points and one of joints."""
    path = tmp_path_factory.mktemp("import")
    cell = calib.load_cell(paper_cell(path))
    data, _, _ = simulated(cell, calib.load_plan(cell, path / "plan.csv"), 3)
    text = measurements_csv(cell, data)
    (path / "measured.csv").write_text(text)
    header, *rows = (line.split(",") for line in text.splitlines())
    x = header.index("x_mm")
    points = [[*row[:2], *row[x : x + 3]] for row in (header, *rows[::-1])]
    joints = dict.fromkeys(",".join([row[0], *row[2:x], *row[x + 3 :]]) for row in (header, *rows))
    (path / "points.csv").write_text("\n".join(map(",".join, points)))
    (path / "joints.csv").write_text("\n".join(joints))
    return path


def test_joined_table_is_the_measured_one(two_tables: Path) -> None:
    """The order is that of the joints."""
    out, result = two_tables / "joined.csv", two_tables / "joined.json"
    done = run(
        "import", two_tables / "points.csv", "--joints", two_tables / "joints.csv",
        "-o", out, "--json", result,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "30 poses, 90 points" in done.output
    cell = calib.load_cell(two_tables / "cell.toml")
    ours, truth = (calib.load_measurements(cell, p) for p in (out, two_tables / "measured.csv"))
    assert ours.poses.names == truth.poses.names
    for name in ("q", "wrench"):
        np.testing.assert_array_equal(getattr(ours.poses, name), getattr(truth.poses, name))
    np.testing.assert_array_equal(ours.points, truth.points)
    fields = json.loads(result.read_text(), parse_constant=pytest.fail)
    assert (fields["schema"], fields["command"]) == (1, "import")
    assert (fields["poses"], fields["points"]) == (30, 90)
    assert fields["markers"] == {"m1": 30, "m2": 30, "m3": 30}
    named = {Path(entry["file"]).name for entry in fields["inputs"]}
    assert named == {"points.csv", "joints.csv"}


def test_a_plan_may_give_the_joints(two_tables: Path) -> None:
    """Its columns of order and level say nothing of a reading."""
    text = (two_tables / "joints.csv").read_text().splitlines()
    plan = [f"{line},{k or 'order'}" for k, line in enumerate(text)]
    (two_tables / "ordered.csv").write_text("\n".join(plan))
    done = run(
        "import",
        two_tables / "points.csv",
        "--joints",
        two_tables / "ordered.csv",
        "-o",
        two_tables / "o.csv",
    )
    assert done.exit_code == 0, done.output
    assert "order" not in (two_tables / "o.csv").read_text()


def test_images_of_a_board_become_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the recipe that the page shows; an image without a board has no rows."""
    photographs = pytest.importorskip("tests.photographs")
    monkeypatch.chdir(tmp_path)
    Path("images").mkdir()
    drawn, truth = photographs.charuco(), []
    for k in range(2):
        T = photographs.facing(0.2 * k, (0.3 * k, 0.1), (0.25, 0.18), 0.5)
        image = photographs.photograph(drawn, T)
        photographs.cv2.imwrite(f"images/shot{k}.png", image)
        truth.append(photographs.pixels(photographs.points_of(), T))
    photographs.cv2.imwrite("images/shot2.png", np.full((720, 960), 90, np.uint8))
    (block,) = blocks("CharucoDetector")
    exec(compile(block, "import.md", "exec"), {})
    Path("kr270.urdf").write_text(embedded_text("kr270.urdf"))
    text = camera_cell(photographs.CHARUCO, PINHOLE, "kr270.urdf", "base_link", "tool0")
    Path("cell.toml").write_text(text.replace("[boards.b]", "[boards.table]"))
    header = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7))
    Path("joints.csv").write_text(f"{header}\nshot1,1,-90,90,0,0,1\nshot0,0,-90,90,0,0,0\n")
    done = run("import", "points.csv", "--joints", "joints.csv", "-o", "day.csv")
    assert done.exit_code == 0, done.output
    data = calib.load_measurements(calib.load_cell("cell.toml"), "day.csv")
    assert data.poses.names == ("shot1", "shot0")
    np.testing.assert_allclose(data.readings, truth[::-1], atol=0.3)


def test_motions_are_chosen_by_the_command(tmp_path: Path) -> None:
    """The robot file's joints within their limits; the table of what was chosen."""
    joints = ("j1", "j2", "j3", "j4")
    limits = "\n".join(f"{joint} = [-60, 60]" for joint in joints)
    speeds = "\n".join(f"{joint} = 60" for joint in joints)
    cell = tmp_path / "cell.toml"
    cell.write_text(
        f'schema = 1\n[robot]\nmjcf = "{arm(tmp_path).name}"\nbase = "base"\ntip = "tip"\n'
        f"[robot.limits_deg]\n{limits}\n[robot.speed_deg_s]\n{speeds}\n"
        '[model]\neffects = ["coulomb_friction", "viscous_friction", "armature"]\n'
    )
    asked = ("design", cell, "--motions", 2, "--candidates", 10)
    found, said = result(tmp_path / "motions.json", *asked, kind="design_motions")
    assert [own["session"] for own in found["chosen"]] == ["motion1", "motion2"]
    assert 0.5 < found["efficiency"] <= 1.0
    assert "2 motions" in said
    done = run(*asked, "--reapproach", "0")
    assert done.exit_code == 2
    assert "--reapproach" in done.output
