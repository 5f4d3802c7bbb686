"""``posecal program``: what is written is read back and is the plan."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arm.robot import Source
from calib.errors import InputError
from calib.poses import poses_at
from doe.constraints import constraints_of
from doe.constraints.clearance import Clearance
from doe.day.day import day_of
from doe.day.straight import straight
from studies.programs.languages import (
    LANGUAGES,
    Stop,
    axis_names,
    identifier,
    plain_text,
    plan_stops,
)
from tests.helpers import cell_of, random_robot
from tests.studies.command_line import paper_cell
from tests.studies.command_line import run as posecal

run = partial(posecal, "program")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    paper_cell(tmp_path)
    return tmp_path


def krl_targets(text: str) -> list[list[float]]:
    """Axis values in rad, A1 to A6 in this order."""
    lists = re.findall(r"^PTP \{(.*)\}$", text, flags=re.M)
    pairs = [re.findall(r"A(\d) (-?\d+\.\d+)", line) for line in lists]
    assert all([axis for axis, _ in pair] == list("123456") for pair in pairs)
    return [[np.radians(float(value)) for _, value in pair] for pair in pairs]


def urscript_targets(text: str) -> list[list[float]]:
    return [
        [float(value) for value in line.split(",")]
        for line in re.findall(r"^  movej\(\[([^]]*)\]", text, flags=re.M)
    ]


def rapid_targets(text: str) -> list[list[float]]:
    """Six axes of the arm in rad; no external axis."""
    lists = re.findall(r"^    MoveAbsJ \[\[([^]]*)\],\[([^]]*)\]\]", text, flags=re.M)
    assert {external for _, external in lists} == {",".join(["9E9"] * 6)}
    return [[np.radians(float(value)) for value in arm.split(",")] for arm, _ in lists]


def fanuc_targets(text: str) -> list[list[float]]:
    """Joint positions in rad, in the order in which the program drives to them."""
    program, positions = text.split("/POS\n")
    order = re.findall(r"^ *\d+:J P\[(\d+)\] \d+% FINE ;$", program, flags=re.M)
    found = {}
    for number, body in re.findall(r"^P\[(\d+)\]\{(.*?)\};$", positions, flags=re.M | re.S):
        pairs = re.findall(r"J(\d)= (-?\d+\.\d+) deg", body)
        assert [axis for axis, _ in pairs] == list("123456")
        found[number] = [np.radians(float(value)) for _, value in pairs]
    return [found[number] for number in order]


@pytest.mark.parametrize(
    ("ending", "read", "finest"),
    [
        (".src", krl_targets, np.radians(1e-6)),
        (".script", urscript_targets, 1e-9),
        (".mod", rapid_targets, np.radians(1e-6)),
        (".ls", fanuc_targets, np.radians(1e-6)),
    ],
)
def test_program_holds_the_plan(folder: Path, ending: str, read, finest: float) -> None:  # type: ignore[no-untyped-def]
    done = run(
        folder / "cell.toml", folder / "plan.csv", "-o", folder / f"p{ending}",
        "--json", folder / "p.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(folder / "cell.toml")
    plan = calib.load_plan(cell, folder / "plan.csv")
    text = (folder / f"p{ending}").read_text()
    np.testing.assert_allclose(read(text), plan.q, rtol=0, atol=0.51 * finest)
    fields = json.loads((folder / "p.json").read_text(), parse_constant=pytest.fail)
    assert fields["poses"] == list(plan.names)
    waits = len(re.findall(r"^HALT$|^  popup\(|^    Stop;$|^ *\d+:  PAUSE ;$", text, flags=re.M))
    assert waits == fields["stops"] == 2 * len(plan)  # free, and with the cell's load
    text = re.sub(r" ;\n *\d+:  !", " ", text)  # remarks of the pendant are broken into pieces
    assert len(re.findall("hang 250 kg", re.sub("TPWrite.*", "", text))) == len(plan)
    assert "zero positions" in text
    assert "not checked for collisions" in text


def test_a_cell_without_load_has_one_stop_a_pose(folder: Path) -> None:
    cell = folder / "cell.toml"
    cell.write_text(re.sub(r"\[load\].*?(?=\[design\])", "", cell.read_text(), flags=re.S))
    assert run(cell, folder / "plan.csv", "-o", folder / "p.src").exit_code == 0
    text = (folder / "p.src").read_text()
    assert text.count("\nHALT\n") == len(krl_targets(text)) == 15
    assert "hang" not in text


@pytest.mark.parametrize("ending", [".src", ".script", ".mod", ".ls"])
def test_poses_that_nothing_checked_are_said_in_the_first_line(folder: Path, ending: str) -> None:
    cell, urdf = folder / "cell.toml", folder / "kr270.urdf"
    assert not calib.load_cell(cell).shapes.capsules.keys() - {"base"}
    done = run(cell, folder / "plan.csv", "-o", folder / f"p{ending}")
    assert "The poses are not checked for collisions, as the arm has no shape" in done.output
    mesh = '<collision><geometry><mesh filename="one; HALT.stl"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace('<link name="link_2">', f'<link name="link_2">{mesh}'))
    done = run(cell, folder / "plan.csv", "-o", folder / f"q{ending}")
    assert done.exit_code == 0, done.output
    assert "link_2 (one; HALT.stl is not there)" in " ".join(done.output.split())
    text = re.sub(r" ;\n *\d+:  !", " ", (folder / f"q{ending}").read_text())
    first = next(line for line in text.splitlines() if re.search(r"(;|#|!) ?[A-Z]", line))
    assert "The poses are not checked for collisions, as shapes cannot be read: link_2" in first
    assert "one; HALT" not in text


PRINTED = 'p"); halt() PTP {A1 0}; $OV_PRO=100 \\" &<>#'
HOSTILE = f"{PRINTED}\nHALT\r\nPTP {{A1 0}}\u2028\x7f\x1b[2J"


def code(text: str) -> list[str]:
    """The lines without comments and without the text of popups."""
    lines = [re.split(r"[;#!]", line)[0].rstrip() for line in text.splitlines()]
    lines = [re.sub(r'(popup\(|TPWrite )"[^"\\]*"', r"\1", line) for line in lines]
    lines = [line for line in lines if not re.fullmatch(r" *\d+:", line)]  # a FANUC remark
    return [re.sub(r"^ *\d+:", "", line) for line in lines]


@pytest.mark.parametrize("ending", LANGUAGES)
@pytest.mark.parametrize("name", [PRINTED, HOSTILE])
def test_a_name_cannot_become_code(folder: Path, ending: str, name: str) -> None:
    cell = calib.load_cell(folder / "cell.toml")
    plan = calib.load_plan(cell, folder / "plan.csv")
    evil = replace(plan, names=(name, *plan.names[1:]))
    plain, other = (
        LANGUAGES[ending]("p", cell, plan_stops(day_of(cell, poses), "plan.csv"), ()).text
        for poses in (plan, evil)
    )
    assert other != plain
    assert other.isascii()
    assert code(other) == code(plain)


def test_names_in_tables(folder: Path) -> None:
    """What can be printed gets into a program as it may, what cannot is refused."""
    rows = [*csv.reader((folder / "plan.csv").read_text().splitlines())]
    for name, status in ((PRINTED, 0), (HOSTILE, 2)):
        rows[1][0] = name
        with (folder / "evil.csv").open("w", newline="") as file:
            csv.writer(file).writerows(rows)
        done = run(folder / "cell.toml", folder / "evil.csv", "-o", folder / "p.src")
        assert done.exit_code == status, done.output
    assert "holds a character that cannot be printed" in done.output


def test_file_names_become_identifiers() -> None:
    for text in ("plan", "2", "über plan", "a" * 40, "WAIT", "x();END", "../x", "_"):
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", identifier(text)), text
    assert identifier("plan_2") == "plan_2"
    assert plain_text("pose 1 (free), +3.5") == "pose 1 (free), +3.5"
    assert len(plain_text("x" * 500)) == 60


def test_external_axes_and_those_that_slide() -> None:
    rng = np.random.default_rng(0)
    rail = cell_of(random_robot(rng, 7, prismatic=[0]), np.zeros((1, 3)), ())
    with pytest.raises(InputError, match="do not tell which are the axes A1 to A6"):
        axis_names(rail)
    named = ("rail_e1", *(f"joint_a{k}" for k in range(1, 7)))
    rail = replace(rail, robot=replace(rail.robot, joints=named))
    assert axis_names(rail) == ("E1", "A1", "A2", "A3", "A4", "A5", "A6")
    stops = [Stop("p", np.array([0.25, *np.radians([1, 2, 3, 4, 5, 6])]), ("measure",))]
    text = LANGUAGES[".src"]("plan", rail, stops, ()).text
    assert "PTP {E1 250.000000,A1 1.000000,A2 2.000000," in text
    with pytest.raises(InputError, match="7 joints, rail_e1 slides"):
        LANGUAGES[".script"]("plan", rail, stops, ())
    assert axis_names(replace(rail, robot=random_robot(rng, 8)))[5:] == ("A6", "E1", "E2")
    with pytest.raises(InputError, match="do not tell"):
        axis_names(replace(rail, robot=random_robot(rng, 13)))


def test_rapid_and_fanuc_have_limits_of_their_own() -> None:
    rng = np.random.default_rng(0)
    rail = cell_of(random_robot(rng, 7, prismatic=[6]), np.zeros((1, 3)), ())
    stops = [Stop("p", np.array([*np.radians([1, 2, 3, 4, 5, 6]), 0.25]), ("measure; it" * 9,))]
    text = LANGUAGES[".mod"]("plan", rail, stops, ()).text
    assert "[[1.000000,2.000000,3.000000,4.000000,5.000000,6.000000],[250.000000,9E9," in text
    assert max(len(s) for s in re.findall(r'TPWrite "([^"]*)"', text)) <= 80
    text = LANGUAGES[".ls"]("2nd", rail, stops, ()).text
    assert text.startswith("/PROG  P_2ND\n")
    assert "    J7= 250.000000 mm\n};" in text
    assert all(line.count(";") == 1 for line in text.split("/POS")[0].splitlines() if ":" in line)
    for chain, ending, said in (
        (random_robot(rng, 7, prismatic=[0]), ".mod", "7 joints, j1 slides"),
        (random_robot(rng, 5), ".mod", "this chain has 5 joints"),
        (random_robot(rng, 10), ".ls", "at most 9 axes; this chain has 10"),
    ):
        with pytest.raises(InputError, match=said):
            LANGUAGES[ending]("plan", replace(rail, robot=chain), stops, ())


def test_a_cell_with_mjcf_is_told_of_its_mjcf() -> None:
    robot = replace(random_robot(np.random.default_rng(0), 6), source=Source("mjcf"))
    cell = cell_of(robot, np.zeros((1, 3)), ())
    for language in LANGUAGES.values():
        text = language("plan", cell, [Stop("p", np.zeros(6), ("measure",))], ()).text
        text = re.sub(r" ;\n *\d+:  !", " ", text)
        assert "Taken from the MJCF and to be checked: zero positions" in text
        assert "URDF" not in text
    with pytest.raises(InputError, match="limits in MJCF and cell"):
        plan_stops(day_of(cell, poses_at(np.full((1, 6), 100.0))), "plan.csv")
    chain = replace(random_robot(np.random.default_rng(0), 13), source=Source("mjcf"))
    many = replace(cell, robot=chain)
    with pytest.raises(InputError, match="let the MJCF's names end so"):
        axis_names(many)


BALL_BETWEEN = """
[design]
obstacle = [{ type = "sphere", center_mm = [2400, 0, 700], radius_mm = 250 }]
[robot.capsules_mm]
A3 = [{ from = [0, 0, 0], to = [1200, 0, 0], radius = 60 }]
[robot.speed_deg_s]
A1 = 100
A2 = 100
A3 = 100
A4 = 100
A5 = 100
A6 = 100
"""
BESIDE = (
    "pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\nleft,{0},-1,0,0,0,0\nright,{1},-1,0,0,0,0\n"
)


@pytest.fixture
def obstructed(folder: Path) -> Path:
    """The arm stretched forward on both sides of a ball."""
    cell = folder / "cell.toml"
    text = re.sub(r"\[design\].*?(?=\n# \[diagnosis\])", "", cell.read_text(), flags=re.S)
    text = re.sub(r"\[load\].*?(?=\n\n)", "", text, flags=re.S)
    cell.write_text(text + BALL_BETWEEN)
    (folder / "beside.csv").write_text(BESIDE.format(-40, 40))
    return folder


@pytest.mark.parametrize(
    ("ending", "read"),
    [
        (".src", krl_targets),
        (".script", urscript_targets),
        (".mod", rapid_targets),
        (".ls", fanuc_targets),
    ],
)
def test_a_program_leads_round_what_is_met(obstructed: Path, ending: str, read) -> None:  # type: ignore[no-untyped-def]
    """The points that are driven to are proved free, and are those of the record."""
    made = obstructed / f"p{ending}"
    done = run(
        obstructed / "cell.toml",
        obstructed / "beside.csv",
        "-o",
        made,
        "--json",
        obstructed / "p.json",
    )
    assert done.exit_code == 0, done.output
    assert "1 of 1 between poses are free: 0 straight, 1 over points between" in done.output
    text, fields = made.read_text(), json.loads((obstructed / "p.json").read_text())
    points = np.array(read(text))
    assert len(points) > 2
    cell = calib.load_cell(obstructed / "cell.toml")
    kept = [own for own in constraints_of(cell) if isinstance(own, Clearance)]
    assert straight(cell, kept, points[:-1], points[1:]).free.all()
    assert not straight(cell, kept, points[:1], points[-1:]).free[0]
    (other,) = fields["day"]["others"]
    assert other["meets"] == "obstacle 1 (sphere)"
    between = [list(p["joints_deg"].values()) for p in other["points"]]
    np.testing.assert_allclose(np.degrees(points[1:-1]), between, atol=1e-5)
    waits = len(re.findall(r"^HALT$|^  popup\(|^    Stop;$|^ *\d+:  PAUSE ;$", text, flags=re.M))
    assert waits == fields["stops"] == 2


@pytest.mark.sampled
@pytest.mark.parametrize("ending", LANGUAGES)
def test_a_program_waits_where_no_way_is_known(obstructed: Path, ending: str) -> None:
    """A wall that no arm passes: the program stops before the pose behind it."""
    cell = obstructed / "cell.toml"
    wall = '{ type = "box", center_mm = [0, 0, 1000], size_mm = [8000, 20, 8000] }'
    cell.write_text(re.sub(r"obstacle = \[.*\]", f"obstacle = [{wall}]", cell.read_text()))
    made = obstructed / f"p{ending}"
    done = run(cell, obstructed / "beside.csv", "-o", made)
    assert done.exit_code == 0, done.output
    assert "no way was found from left to right: the straight one meets obstacle" in " ".join(
        done.output.split()
    )
    text = made.read_text()
    waits = len(re.findall(r"^HALT$|^  popup\(|^    Stop;$|^ *\d+:  PAUSE ;$", text, flags=re.M))
    assert waits == 3
    text = re.sub(r" ;\n *\d+:  !", " ", text)
    assert "no way to pose right is known: the straight one meets obstacle" in text


def test_a_start_in_collision_is_one_line(obstructed: Path) -> None:
    (obstructed / "beside.csv").write_text(BESIDE.format(0, 40))
    done = run(obstructed / "cell.toml", obstructed / "beside.csv", "-o", obstructed / "p.src")
    assert done.exit_code != 0
    cell = calib.load_cell(obstructed / "cell.toml")
    day = day_of(cell, calib.load_plan(cell, obstructed / "beside.csv"))
    with pytest.raises(InputError, match="pose left: is where the arm does not keep clear: obst"):
        plan_stops(day, "beside.csv")
    assert not (obstructed / "p.src").exists()
