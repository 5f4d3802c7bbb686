"""Cells: what their tables say, what is refused in one line, and the cell with found effects."""

from __future__ import annotations

import tomllib
from dataclasses import astuple, is_dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.diagnosis.candidates import candidates
from calib.files.cell_out import Extended, extended_cell
from calib.files.write_tables import measurements_csv
from calib.instruments import Distance, KnownDistance, Plane, Socket
from calib.model.build import build, context_of, place_effect
from studies.demo.embedded import embedded_text
from tests.day import SCARA, file_day
from tests.helpers import all_seen
from tests.studies.command_line import paper_cell


@pytest.mark.parametrize("stated", [True, False])
def test_a_compensator_is_a_term_of_torques_where_its_anchors_are_stated(
    stated: bool, tmp_path: Path
) -> None:
    anchors = "[robot.compensators_mm]\nA2 = { before = [-686, 0, 123], after = [185, 0, 0] }\n"
    old = 'effects = ["base", "tool",'
    cell = cell_with(tmp_path, more=anchors * stated, old=old, new=f'{old} "gravity_compensator",')
    assert "gravity_compensator" in cell.effects
    assert cell.motion.effects == (("gravity_compensator:A2",) if stated else ())


def cell_with(folder: Path, robot: str = "", more: str = "", old: str = "", new: str = "") -> Cell:
    """The embedded cell with lines added to [robot], tables at the end, and words replaced."""
    path = paper_cell(folder)
    text = path.read_text().replace('tip = "tool0"\n', f'tip = "tool0"\n{robot}')
    assert old in text
    path.write_text((text.replace(old, new) if old else text) + f"\n{more}")
    return calib.load_cell(path)


def excluding(*names: str) -> str:
    return f"[diagnosis]\nexclude = {[*names]!r}\n"


def asked(cell: Cell, poses: Poses) -> tuple[set[str], dict[str, str]]:
    """Causes by name that are candidates, and what is not, with the reason."""
    data = all_seen(poses, np.ones((len(poses), len(cell.markers), 3)))
    found, missing = candidates(cell, build(cell, poses).model, data)
    return {c.key for c in found if c.named}, {n.effect: n.reason for n in missing}


# -- What tables say

NONE = [np.nan] * 3
FACED = {
    "old": "m1 = [279.2, -16.4, -91.9]",
    "new": "m1 = { position = [279.2, -16.4, -91.9], normal = [0, 3, -4], acceptance_deg = 60 }",
}
TIMING = "[timing]\nspeed_percent = 20\nload_change_min = 3\nread_s = 4\nsettle_s = 7\n"


def sigma(form: str) -> dict[str, str]:
    return {"old": "sigma_mm = 0.010", "new": f"sigma_mm = {{ {form} }}"}


BEAM = "range_mm = 0.01, transverse_mm = 0.02"


@pytest.mark.parametrize(
    ("field", "expected", "lines"),
    [
        (
            "repeatability",
            (3e-5, 1e-4),
            {"robot": "repeatability_mm = 0.03\nrepeatability_urad = 100\n"},
        ),
        ("repeatability", (3e-5, 0.0), {"robot": "repeatability_mm = 0.03\n"}),
        ("repeatability", (0.0, 1e-4), {"robot": "repeatability_urad = 100\n"}),
        ("repeatability", (0.0, 0.0), {"robot": "repeatability_mm = 0\n"}),
        ("load.mass", 250.0, {}),
        ("load.com", (0.3, 0.0, 0.15), {}),
        ("payload.com", (1e-3, 2e-3, 3e-3), {"more": "[payload]\ncom_mm = [1, 2, 3]\n"}),
        ("pace", (0.2, 7.0, 4.0, 180.0), {"more": TIMING}),
        ("robot.speeds", NONE * 2, {}),
        (
            "robot.speeds",
            (np.nan, np.pi / 2, *NONE, np.pi),
            {"more": "[robot.speed_deg_s]\nA2 = 90\nA6 = 180\n"},
        ),
        (
            "robot.accelerations",
            (2 * np.pi, *NONE, np.nan, np.nan),
            {"more": "[robot.acceleration_deg_s2]\nA1 = 360\n"},
        ),
        ("marker_normals", ((0.0, 0.6, -0.8), NONE, NONE), FACED),
        ("marker_acceptance", (np.pi / 3, np.nan, np.nan), FACED),
        ("design.margin", 0.03, {"old": "[design]", "new": "[design]\nmargin_mm = 30"}),
        ("noise", (1e-5, 2e-5, 0.0, 0.0), sigma(BEAM)),
        (
            "noise",
            (1e-5, 2e-5, 1e-6, 6e-6),
            sigma(f"{BEAM}, range_mm_per_m = 0.001, transverse_mm_per_m = 0.006"),
        ),
        (
            "noise",
            (5e-6, 5e-6, 2e-6, 2e-6),
            sigma("mpe_mm = 0.02, mpe_mm_per_m = 0.008, divisor = 4"),
        ),
    ],
)
def test_keys_have_units_and_fields_are_in_si(
    tmp_path: Path, field: str, expected: object, lines: dict[str, str]
) -> None:
    found = attrgetter(field)(cell_with(tmp_path, **lines))
    numbers = astuple(found) if is_dataclass(found) else found
    np.testing.assert_allclose(numbers, expected, rtol=1e-12)


def test_torques_of_one_ampere(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, more="[robot.torque_constant_Nm_A]\nA2 = 12.5\n")
    assert cell.motion.constants == {"A2": 12.5}


def test_keys_of_joints_that_slide(tmp_path: Path) -> None:
    keys = ("limits_mm = { Z = [-150, -50] }", "speed_mm_s = { Z = 400 }")
    more = "\n".join(["[robot]", *keys, "acceleration_mm_s2 = { Z = 2000 }"])
    path = file_day(SCARA, poses=2).written(tmp_path) / "cell.toml"
    path.write_text(path.read_text().replace("[robot]", more, 1))
    robot, k = calib.load_cell(path).robot, 2
    assert robot.limits[k] == pytest.approx([-0.15, -0.05])
    assert (robot.speeds[k], robot.accelerations[k]) == pytest.approx((0.4, 2.0))


def test_nothing_said_of_repeatability_is_none(tmp_path: Path) -> None:
    assert cell_with(tmp_path).repeatability is None


def test_speeds_of_the_cell_go_before_those_of_the_urdf(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, more="[robot.speed_deg_s]\nA2 = 90\n")
    urdf = embedded_text("kr270.urdf").replace('velocity="0"', 'velocity="1.5"', 2)
    (tmp_path / "kr270.urdf").write_text(urdf)
    assert calib.load_cell(cell.path).robot.speeds[:2] == pytest.approx([1.5, np.pi / 2])


def test_excluded_causes_are_not_asked(tmp_path: Path, table_two: Poses) -> None:
    cell = cell_with(tmp_path)
    assert cell.excluded == ()
    everything, _ = asked(cell, table_two)
    names = ("gravity_compensator", "joint_coupling:A3, A4")
    cell = cell_with(tmp_path, more=excluding(*names))
    assert cell.excluded == ("gravity_compensator", "joint_coupling:A3", "joint_coupling:A4")
    left, reasons = asked(cell, table_two)
    gone = everything - left
    assert gone == {*(f"gravity_compensator:A{k}" for k in range(1, 7)), *cell.excluded[1:]}
    assert {reasons[cause] for cause in gone} == {"excluded by the cell"}


def test_geometry_at_places_leaves_its_parts_elsewhere_in_the_contest(
    tmp_path: Path, table_two: Poses
) -> None:
    cell = replace(cell_with(tmp_path), effects=("base", "tool", "geometry:A2,A4,tool0"))
    here, _ = asked(cell, table_two)
    for kind, ends in (("joint_offset", ()), ("link_geometry", ("tool0",))):
        places = {key.partition(":")[2] for key in here if key.startswith(f"{kind}:")}
        assert places == {*cell.robot.joints, *ends} - {"A2", "A4", "tool0"}


# -- Instruments that touch

URDF = """<robot name="r"><link name="base"/><link name="tip"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0.3 0 0.2"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint></robot>"""
TOUCHING = """schema = 1
[robot]
urdf = "r.urdf"
base = "base"
tip = "tip"
[markers_mm]
ball = [50, 0, 100]
[instruments.left]
kind = "socket"
sigma_mm = 0.3
[instruments.wire]
kind = "distance"
sigma_mm = 0.1
anchor_mm = [100, 0, 0]
offset = true
[instruments.right]
kind = "socket"
sigma_mm = 0.3
[instruments.table]
kind = "plane"
sigma_mm = 0.01
[[known_distances]]
between = ["left", "right"]
mm = 50.0
sigma_mm = 0.05
[model]
effects = ["joint_offset:j1"]
"""
TABLE = """pose,instrument,marker,j1_deg,d_mm
a,left,ball,10,
b,wire,ball,20,321.5
c,right,ball,30,
d,table,ball,40,
e,table,ball,50,0.25
"""


def touched(folder: Path, old: str = "", new: str = "") -> tuple[Cell, calib.Measurements]:
    """Cell and table, with words of theirs replaced."""
    (folder / "r.urdf").write_text(URDF)
    (folder / "cell.toml").write_text(TOUCHING.replace(old, new, 1))
    (folder / "m.csv").write_text(TABLE.replace(old, new, 1))
    cell = calib.load_cell(folder / "cell.toml")
    return cell, calib.load_measurements(cell, folder / "m.csv")


def test_sockets_are_one_instrument_at_several_sites(tmp_path: Path) -> None:
    """An empty gauge reads nothing, and places are unknown though the model has no base."""
    cell, data = touched(tmp_path)
    wire, plane, sockets = cell.instruments
    assert isinstance(wire, Distance)
    assert wire.known
    np.testing.assert_allclose(wire.standing, [0.1, 0.0, 0.0])
    assert [u.name for u in wire.unknowns] == ["offset"]
    assert isinstance(plane, Plane)
    assert plane.sigma == pytest.approx(1e-5)
    assert isinstance(sockets, Socket)
    assert sockets.sites == ("left", "right")
    assert cell.known_distances == (KnownDistance(("left", "right"), 0.05, pytest.approx(5e-5)),)
    assert data.poses.site is not None
    assert data.poses.site.tolist() == ["left", "", "right", "", ""]
    assert data.seen.sum(axis=0).tolist() == [1, 2, 2]
    np.testing.assert_allclose(data.readings[[1, 4], [0, 1], 0], [0.3215, 0.00025])
    assert np.count_nonzero(data.readings) == 2
    (tmp_path / "m.csv").write_text(measurements_csv(cell, data))
    back = calib.load_measurements(cell, tmp_path / "m.csv")
    np.testing.assert_array_equal(back.poses.site, data.poses.site)
    np.testing.assert_allclose(back.readings, data.readings, atol=1e-9)
    assert [i for i in calib.parameters(cell) if i.startswith("base:")] == [
        "base:wire.offset",
        *(f"base:table.{c}" for c in ("rx", "ry", "height")),
        *(f"base:{name}.{c}" for name in ("left", "right") for c in "xyz"),
    ]


PAIR = 'between = ["left", "right"]'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (PAIR, 'between = ["left", "wire"]', "not two sockets or two"),
        (PAIR, 'between = ["left", "left"]', "not two sockets or two"),
        ('kind = "plane"', 'kind = "plain"', "instruments.table"),
        ('kind = "plane"', 'kind = "sphere"', "has no known kind; write camera, distance, plane"),
        ("sigma_mm = 0.01", "sigma_mm = 0.01\noffset = true", "instruments.table.offset"),
        ("b,wire,ball,20,321.5", "b,wire,ball,20,", "line 3, column d_mm: is empty"),
        ("c,right,ball,30,", "a,right,ball,10,", "touches 'left' too; give each its own pose"),
        ("a,left,", "a,middle,", "'middle' is not in the cell; instruments are wire"),
    ],
)
def test_faults_of_what_touches(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in TOUCHING + TABLE
    with pytest.raises(calib.CalibError, match=said):
        touched(tmp_path, old, new)


# -- A cell with found effects is the user's own file, and loads wherever it is written


def written(folder: Path) -> Cell:
    """The embedded cell in a folder of its own."""
    (folder / "here").mkdir()
    return calib.load_cell(paper_cell(folder / "here"))


def extended(cell: Cell, plan: Poses, path: Path, *names: str) -> Extended:
    """With effects found at poses that say from which side each joint came."""
    sides = np.sign(np.sin(np.arange(plan.q.size).reshape(plan.q.shape)))
    poses = replace(plan, approach=sides)
    context = context_of(cell, poses)
    effects = [place_effect(*name.split(":"), context) for name in names]
    return extended_cell(cell, effects, poses, path)


def test_all_else_stays_and_the_new_cell_loads(tmp_path: Path, table_two: Poses) -> None:
    cell, names = written(tmp_path), ("backlash:A3", "stiffness_vs_angle:A3")
    target = tmp_path / "there" / "better.toml"
    target.parent.mkdir()
    made = extended(cell, table_two, target, *names)
    target.write_text(made.text)
    before, after = cell.path.read_text().splitlines(), made.text.splitlines()
    lost = [line for line in before if line not in after]
    assert [line.split(" =")[0] for line in lost] == ["urdf", "effects"]
    assert (made.added, made.replaced) == (names, ("joint_compliance:A3",))
    assert not made.refused
    again = calib.load_cell(target)
    kept = ("base", "tool", "geometry", "stiffness_vs_angle:A2", "joint_compliance:A4,A5,A6")
    assert again.effects == (*kept, *names)
    found = place_effect("stiffness_vs_angle", "A3", context_of(cell, table_two))
    np.testing.assert_allclose(again.knots["A3"], found.knots, atol=1e-8)  # type: ignore[attr-defined]
    np.testing.assert_allclose(again.knots["A2"], cell.knots["A2"])
    assert again.robot_files[0].resolve() == cell.robot_files[0].resolve()
    assert tomllib.loads(made.text)["robot"]["urdf"] == "../here/kr270.urdf"


def test_paths_change_with_the_folder_alone(tmp_path: Path, table_two: Poses) -> None:
    cell = written(tmp_path)
    made = extended(cell, table_two, cell.path.with_name("other.toml"))
    assert (made.text, made.added) == (cell.path.read_text(), ())
    cell.path.write_text(made.text.replace('# targets = "targets.csv"', 'targets = "targets.csv"'))
    joints = ",".join(f"A{k}_deg" for k in range(1, 7))
    cell.path.with_name("targets.csv").write_text(f"{joints}\n0,-60,70,20,45,10\n")
    made = extended(calib.load_cell(cell.path), table_two, tmp_path / "new.toml")
    assert tomllib.loads(made.text)["design"]["targets"] == "here/targets.csv"


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ('[model]\neffects = [\n  "base", # bolted down\n  "tool",\n]\n', ["base", "tool"]),
        ('model = { effects = ["base", "tool", "joint_compliance:A3"] }\n', ["base", "tool"]),
        (
            '[model]\neffects = ["base", "tool", "joint_compliance"]\n',
            ["base", "tool", "joint_compliance:A1,A2,A4,A5,A6"],
        ),
    ],
    ids=["with comments", "in one line", "everywhere"],
)
def test_any_way_to_write_the_model(
    tmp_path: Path, table_two: Poses, model: str, expected: list[str]
) -> None:
    path = written(tmp_path).path
    head = path.read_text().split("[model]", 1)[0]
    path.write_text(model + head if model.startswith("model") else head + model)
    made = extended(calib.load_cell(path), table_two, path, "stiffness_vs_angle:A3")
    table = tomllib.loads(made.text)["model"]
    assert table["effects"] == [*expected, "stiffness_vs_angle:A3"]
    assert list(table["knots_deg"]) == ["A3"]
    assert ("# bolted down" in made.text) == ("# bolted down" in model)


def test_what_the_model_cannot_hold_is_left_out_and_said(tmp_path: Path, table_two: Poses) -> None:
    """And of two effects the one that contains the other stays."""
    cell = written(tmp_path)
    path = cell.path.with_name("new.toml")
    made = extended(cell, table_two, path, "joint_offset:A3", "backlash:A4")
    ((name, reason),) = made.refused
    assert (made.added, name) == (("backlash:A4",), "joint_offset:A3")
    assert "in the same way" in reason
    assert extended(cell, table_two, path, "gravity_sag:A2", "gravity_sag:arm").added == (
        "gravity_sag:arm",
    )
