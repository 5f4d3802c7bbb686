"""Commands as a user and an outside check see them: design, import, program, enough, changes."""

from __future__ import annotations

import csv
import hashlib
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.errors import InputError
from doe.criteria import CRITERIA, UNASKED
from studies.command.program import MOST_AXES, program_text
from studies.demo.embedded import embedded_text
from tests import plain_day
from tests.calib.test_motion import arm
from tests.camera_cells import PINHOLE, camera_cell
from tests.helpers import cell_of, random_robot
from tests.studies.command_line import paper_cell, ran, refused, result, run, without_load
from tests.studies.test_texts import run_block

OPTIONS = ("--candidates", 2000, "--levels", "A2=-140,-99.85,-56.9,-25.24,-0.01x3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell with its elastostatic model."""
    path = tmp_path_factory.mktemp("cell")
    paper_cell(path, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
    return path


@pytest.fixture(scope="module")
def planned(folder: Path) -> tuple[dict[str, Any], str]:
    """The JSON of a design, and what is printed."""
    more = ("--against", folder / "plan.csv", "--curve", "-o", folder / "best.csv")
    return result(folder / "best.json", "design", folder / "cell.toml", *OPTIONS, *more)


@pytest.mark.long
def test_plan_is_read_by_the_other_commands(
    folder: Path, planned: tuple[dict[str, Any], str]
) -> None:
    poses = planned[0]["poses"]
    plan = calib.load_plan(calib.load_cell(folder / "cell.toml"), folder / "best.csv")
    assert plan.names == tuple(pose["pose"] for pose in poses)
    shown = [list(pose["joints_deg"].values()) for pose in poses]
    np.testing.assert_allclose(np.degrees(plan.q), shown, atol=1e-9)
    rows = list(csv.DictReader((folder / "best.csv").read_text().splitlines()))
    assert [float(row["level"]) for row in rows] == [pose["level"] for pose in poses]
    assert all(re.fullmatch(r"-?\d+(\.\d{1,2})?", row["A4_deg"]) for row in rows)


@pytest.mark.long
def test_tables_say_what_matters(planned: tuple[dict[str, Any], str]) -> None:
    for words in (
        "15 poses. Expected error at the targets",
        "Taken for granted: a model that lacks nothing, an arm that repeats exactly; 200 poses spread",
        "no plan is below",
        "plan.csv",
        "9 parameters",
    ):
        assert words in planned[1]
    assert "nan" not in planned[1].lower()


@pytest.mark.long
def test_a_plan_found_is_its_own_equal(folder: Path, planned: tuple[dict[str, Any], str]) -> None:
    """Judged beside a new design of the same candidates it has the value it was given.

    Of two plans of one name both are judged.
    """
    value = planned[0]["value"]
    (folder / "other").mkdir(exist_ok=True)
    (folder / "other" / "plan.csv").write_text((folder / "plan.csv").read_text())
    plans = [folder / "best.csv", folder / "plan.csv", folder / "other" / "plan.csv"]
    flags = [word for plan in plans for word in ("--against", plan)]
    again, _ = result(folder / "again.json", "design", folder / "cell.toml", *OPTIONS, *flags)
    rival = again["against"][str(folder / "best.csv")]
    assert rival["value"] == pytest.approx(value, rel=1e-6)
    assert rival["efficiency"] <= 1.0
    assert again["value"] == pytest.approx(value, rel=1e-12)
    assert set(again["against"]) == {str(plan) for plan in plans}


@pytest.mark.long
def test_result_holds_what_the_contract_names(
    folder: Path, planned: tuple[dict[str, Any], str]
) -> None:
    fields, _ = planned
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


def test_it_names_the_poses_that_the_goal_needs_or_how_many_more(small: Path) -> None:
    without_load(small / "cell.toml")
    rows = (small / "data.csv").read_text().splitlines()
    (small / "half.csv").write_text("\n".join([*rows[:8], ""]))

    def asked(*goal: object) -> tuple[dict[str, Any], str]:
        call = ("enough", small / "cell.toml", small / "half.csv", "--plan", small / "plan.csv")
        return result(small / "out.json", *call, *goal, kind="enough")

    now, _ = asked()
    assert now["plan"] == {"poses": 8, "measured": 4, "begun": 0, "to_measure": 4}
    fields, said = asked("--goal-mm", now["order"][1]["task_most_mm"] * 1.0001)
    names = ", ".join(step["pose"] for step in fields["order"][:2])
    assert fields["poses_to_goal"] == 2
    assert f"after 2 more: {names}" in said
    named = {Path(entry["file"]).name for entry in fields["inputs"]}
    assert named == {"cell.toml", "arm.urdf", "half.csv", "targets.csv", "plan.csv"}
    assert all(p["std"] > 0.0 for p in fields["end"]["parameters"])
    _, said = asked("--goal-mm", 5)
    assert "You may stop." in said
    fields, said = asked("--goal-mm", 0.97 * now["end"]["task_most_mm"])
    assert fields["poses_to_goal"] is None
    assert f"--poses {fields['fresh_poses_to_goal']}" in said


SLIP = 3e-4  # rad


@pytest.fixture(scope="module")
def months(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """May and June of one robot, of which the belt of J3 slipped in between, and of July nothing."""
    path = tmp_path_factory.mktemp("months")
    cell = plain_day.write_cell(path)
    for seed, month in enumerate(("may", "june", "july")):
        rng = np.random.default_rng(seed)
        q, values = plain_day.joints(25, rng), plain_day.VALUES.copy()
        values[16] += SLIP * (month == "june")
        points = plain_day.points(plain_day.errors_of(values), q)
        table = path / f"{month}.csv"
        table.write_text(plain_day.table(q, plain_day.read(points, rng)))
        ran("identify", cell, table, "--json", path / f"{month}.json")
    return path


def compared_months(months: Path, after: str, *more: object) -> tuple[dict[str, Any], str]:
    call = ("changes", months / "may.json", months / after, *more)
    return result(months / "out.json", *call, kind="changes")


def test_a_slipped_belt_is_told_with_what_it_does(months: Path) -> None:
    fields, said = compared_months(months, "june.json", "--tolerance-mm", 0.1)
    assert fields["status"] == "changed"
    (moved,) = [p for p in fields["parameters"] if p["moved"]]
    assert moved["id"] == "joint_offset:J3.offset"
    assert moved["change"] == pytest.approx(SLIP * 1e6, rel=0.05)
    assert fields["verdict"] == "does_not"
    assert fields["kept_worst_mm"]["low"] > 0.1
    assert "may.json does not hold within 0.1 mm: at the worst target" in said
    assert "Moved: joint_offset:J3.offset" in said
    named = [Path(entry["file"]).name for entry in fields["inputs"]]
    assert named == ["cell.toml", "arm.csv", "may.json", "june.json"]


def test_a_robot_that_stayed_still_holds(months: Path) -> None:
    fields, said = compared_months(months, "july.json", "--tolerance-mm", 0.1)
    assert (fields["status"], fields["verdict"]) == ("unchanged", "holds")
    assert "No change is found between may.json and july.json" in said
    assert "would go unnoticed" in said
    worst = fields["kept_worst_mm"]
    between = (worst["low"] + worst["high"]) / 2.0
    assert worst["low"] < between < worst["high"] < 0.1
    for tolerance, verdict in ((("--tolerance-mm", between), "cannot_be_said"), ((), None)):
        fields, _ = compared_months(months, "july.json", *tolerance)
        assert fields["verdict"] == verdict


def test_a_cell_that_changed(months: Path, tmp_path: Path) -> None:
    """Results look for their inputs beside them; a cell that changed must be given."""
    folder = shutil.copytree(months, tmp_path / "moved")
    for month in ("may", "june"):
        text = (folder / f"{month}.json").read_text().replace(f"{months}/", "")
        (folder / f"{month}.json").write_text(text)
    call = ("changes", folder / "may.json", folder / "june.json")
    assert "joint_offset:J3.offset" in ran(*call)
    cell = folder / "cell.toml"
    cell.write_text(cell.read_text() + "\n# later\n")
    refused(*call)
    ran(*call, "--cell", cell)


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
    call = ("program", path, tmp_path / "plan.csv", "-o", made)
    fields, _ = result(tmp_path / "p.json", *call)
    cell = calib.load_cell(path)
    plan, text = calib.load_plan(cell, tmp_path / "plan.csv"), made.read_text()
    pattern, size = TARGET[ending]
    found = [re.findall(r"-?\d+\.\d+", own) for own in re.findall(pattern, text, flags=re.M)]
    np.testing.assert_allclose(size * np.array(found, float), plan.q, rtol=0, atol=1e-8)
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
    plan = calib.load_plan(calib.load_cell(paper_cell(tmp_path)), tmp_path / "plan.csv")
    if ending != ".script":
        longer = replace(plan, q=np.c_[0.0 * plan.q, np.full(len(plan), 0.25)])
        free = replace(rail.robot, limits=np.full((7, 2), [-9.0, 9.0]))
        assert "250.000000" in program_text(
            ending, "2", replace(rail, robot=free), longer, "plan.csv", []
        )
    for robot in (random_robot(rng, 5), random_robot(rng, 13), random_robot(rng, 6, prismatic=[0])):
        with pytest.raises(InputError, match="takes six joints that turn"):
            program_text(ending, "p", replace(rail, robot=robot), plan, "plan.csv", [])


def test_joined_table_is_the_measured_one(good: Path, tmp_path: Path) -> None:
    """The order is that of the joints."""
    header, *rows = (good / "points.csv").read_text().splitlines()
    (tmp_path / "points.csv").write_text("\n".join([header, *rows[::-1], ""]))
    joined = tmp_path / "joined.csv"
    call = ("import", tmp_path / "points.csv", "--joints", good / "joints.csv", "-o", joined)
    fields, said = result(tmp_path / "joined.json", *call, kind="import")
    assert "30 poses, 90 points" in said
    cell = calib.load_cell(good / "cell.toml")
    ours, truth = (calib.load_measurements(cell, p) for p in (joined, good / "measurements.csv"))
    assert ours.poses.names == truth.poses.names
    np.testing.assert_array_equal(ours.poses.q, truth.poses.q)
    np.testing.assert_array_equal(ours.points, truth.points)
    assert (fields["schema"], fields["command"]) == (1, "import")
    assert (fields["poses"], fields["points"]) == (30, 90)
    assert fields["markers"] == {"m1": 30, "m2": 30, "m3": 30}
    named = {Path(entry["file"]).name for entry in fields["inputs"]}
    assert named == {"points.csv", "joints.csv"}


def test_a_plan_may_give_the_joints(good: Path, tmp_path: Path) -> None:
    """Its column of order says nothing of a reading; a wrench does."""
    header, *rows = (good / "joints.csv").read_text().splitlines()
    ordered = [f"{header},order,fx_N", *(f"{row},{k},{k / 8}" for k, row in enumerate(rows))]
    (tmp_path / "joints.csv").write_text("\n".join(ordered))
    joined = tmp_path / "joined.csv"
    ran("import", good / "points.csv", "--joints", tmp_path / "joints.csv", "-o", joined)
    found = list(csv.DictReader(joined.read_text().splitlines()))
    assert "order" not in found[0]
    assert [float(row["fx_N"]) for row in found] == [k / 8 for k in range(30) for _ in range(3)]


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
    run_block("CharucoDetector")
    Path("kr270.urdf").write_text(embedded_text("kr270.urdf"))
    text = camera_cell(photographs.CHARUCO, PINHOLE, "kr270.urdf", "base_link", "tool0")
    Path("cell.toml").write_text(text.replace("[boards.b]", "[boards.table]"))
    header = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7))
    Path("joints.csv").write_text(f"{header}\nshot1,1,-90,90,0,0,1\nshot0,0,-90,90,0,0,0\n")
    ran("import", "points.csv", "--joints", "joints.csv", "-o", "day.csv")
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
    assert "--reapproach" in refused(*asked, "--reapproach", 0)
