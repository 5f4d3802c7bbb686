"""``posecal init``: a first cell of a robot's file; a torso whose head watches its hand."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.files.cell import load_cell
from calib.files.tables import load_plan
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from studies.demo.embedded import embedded_text
from tests import two_arms
from tests.calib.test_robots import TABLES
from tests.doe.problems import unpolished
from tests.helpers import all_seen
from tests.studies.command_line import ran, refused, result
from tests.two_arms import COMMON, EYE, PLATE, written

KUKA, PARALLEL = embedded_text("kr270.urdf"), TABLES["three parallel axes"]
MJCF = """<mujoco model="hand arm"><worldbody>
<body name="base"><geom size="0.1" mass="5"/>
<body name="one" pos="0 0 0.3"><joint name="j1" axis="0 0 1" range="-170 170"/><geom size="0.1"/>
<body name="two" pos="0 0 0.3"><joint name="j2" axis="0 1 0" range="-120 120"/><geom size="0.1"/>
<site name="attachment_site" pos="0 0 0.2"/>
<body name="left"><joint name="f1" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
<body name="right"><joint name="f2" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
</body></body></body></worldbody></mujoco>"""

FILES = {
    "arm.urdf": (KUKA, (), "base_link", "tool0"),
    "arm.xml": (MJCF, (), "base", "attachment_site"),
    "arm.csv": (PARALLEL, ("--dh", "classic"), "base", "tip"),
    "scara.csv": (TABLES["a SCARA in other units"], ("--dh", "modified"), "base", "tip"),
}


@pytest.mark.parametrize("name", FILES)
def test_the_cell_loads_and_the_table_fits_it(tmp_path: Path, name: str) -> None:
    text, options, base, tip = FILES[name]
    (tmp_path / name).write_text(text)
    folder = tmp_path / "new" / "cell"
    call = ("init", tmp_path / name, "-o", folder, *options)
    fields, said = result(tmp_path / "out.json", *call, kind="init")
    cell = calib.load_cell(folder / "cell.toml")
    assert (cell.robot.base, cell.robot.tip) == (base, tip)
    table = folder / "measurements.csv"
    header = table.read_text().strip().split(",")
    units = ["mm" if slides else "deg" for slides in cell.robot.prismatic]
    joints = [f"{j}_{u}" for j, u in zip(cell.robot.joints, units, strict=True)]
    assert header == ["pose", "marker", *joints, "x_mm", "y_mm", "z_mm"]
    row = ["p1", "m1", *("1" for _ in joints), "1", "2", "3"]
    table.write_text("\n".join([",".join(header), ",".join(row), ""]))
    assert len(calib.load_measurements(cell, table, every_marker=False)) == 1
    assert fields["command"] == "init"
    assert fields["robot"] == {"form": cell.robot.source.form, "base": base, "tip": tip}
    for lack in ("no limits", "no link masses"):
        assert any(lack in own for own in fields["warnings"]) is (name.endswith(".csv"))
    assert all(f"warning: {own}" in said for own in fields["warnings"])


@pytest.mark.long
def test_it_can_be_planned_with_at_once(tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text("\n".join(PARALLEL.split("\n")[:3]))
    ran("init", tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic")
    cell, plan = tmp_path / "cell.toml", tmp_path / "plan.csv"
    ran("design", cell, "--candidates", 500, "-o", plan, "--criterion", "D")
    assert len(calib.load_plan(calib.load_cell(cell), plan)) == 30


def test_a_repeatability_is_assumed(tmp_path: Path) -> None:
    """As data sheets have it: for 2.7 m an RP of 0.05 to 0.2 mm; of the tip's turn as of joints."""
    (tmp_path / "arm.urdf").write_text(KUKA)
    ran("init", tmp_path / "arm.urdf", "-o", tmp_path)
    assert (tmp_path / "cell.toml").read_text().count("# assumed: ") == 2
    found = calib.load_cell(tmp_path / "cell.toml").repeatability
    assert found is not None
    assert 0.05e-3 < 3.6 * found.translation < 0.2e-3
    assert 0.5 < found.translation / found.rotation < 3.0  # m, half of the arm


KINDS = {"f": "fixed", "r": "revolute", "c": "continuous", "p": "prismatic", "m": "prismatic"}
MIMIC = '<mimic joint="x"/>'


def urdf(joints: str) -> str:
    """Joints as ``parent>child:name:kind``, of which a kind is a letter and m moves by another."""
    parts = [own.replace(">", ":").split(":") for own in joints.split()]
    links = dict.fromkeys(link for parent, child, *_ in parts for link in (parent, child))
    texts = [f'<link name="{link}"/>' for link in links]
    for parent, child, name, kind in parts:
        texts.append(
            f'<joint name="{name}" type="{KINDS[kind]}"><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/>'
            f"{MIMIC * (kind == 'm')}</joint>"
        )
    return f'<robot name="arm">{"".join(texts)}</robot>'


WHERE = [  # joints, the chain that is taken, and what is noted beside it
    ("world>arm:w:f arm>l1:a:r l1>l2:b:r", "2 joints from arm to l2: a, b", ""),
    (
        "base_link>l1:a:r l1>l2:b:r l2>hand:h:f hand>tcp:t:f hand>f1:fa:p hand>f2:fb:m",
        "2 joints from base_link to tcp: a, b; held at zero: fa, fb",
        "",
    ),
    (
        "torso>l1:a:r l1>l2:b:r l2>tool0:t:f torso>head:h:r cart>torso:c:f cart>wheel:w:c",
        "2 joints from torso to tool0: a, b; held at zero: h, w",
        "",
    ),
    (
        "base_link>lift:t:p lift>h1:h:r h1>h2:i:r lift>l1:a:r l1>l2:b:r l2>l3:c:r l3>tool:x:f "
        "tool>f1:f:p tool>f2:g:p base_link>wheel:w:c",
        "4 joints from base_link to tool: t, a, b, c; held at zero: h, i, f, g, w",
        "",
    ),
    (
        "torso>l1:a:r l1>l2:b:r torso>r1:c:r r1>r2:d:r",
        "2 joints from torso to l2: a, b; held at zero: c, d",
        "arms of one length part at 'torso': took that of 'l1', not of 'r1'; --tip takes another; "
        "one --tip for each takes all",
    ),
    ("b>l1:a:r l1>flange:f:f flange>my_tool:t:f", "1 joint from b to my_tool: a", ""),
    (
        "b>l1:pan:r l1>gripper_link:wrist_roll:r gripper_link>frame:f:f gripper_link>jaw:gripper:r",
        "2 joints from b to gripper_link: pan, wrist_roll; held at zero: gripper",
        "gripper moves a gripper and is left out. To include it: --tip jaw",
    ),
    (
        "b>l1:joint1:r l1>stator:s:f stator>mover:jointGripper:r",
        "1 joint from b to stator: joint1; held at zero: jointGripper",
        "jointGripper moves a gripper and is left out",
    ),
    (
        "b>l1:a:r l1>ft:b:f ft>drive:gripper_left_joint:r drive>finger:inner_single_joint:r",
        "1 joint from b to ft: a; held at zero: gripper_left_joint, inner_single_joint",
        "gripper_left_joint, inner_single_joint moves a gripper and is left out",
    ),
    ("b>l1:a:r l1>hand:HandYaw:r", "2 joints from b to hand: a, HandYaw", ""),
    ("b>l1:finger_1:r l1>l2:finger_2:r", "2 joints from b to l2: finger_1, finger_2", ""),
]


@pytest.mark.parametrize(("joints", "chain", "note"), WHERE)
def test_where_an_arm_begins_and_ends(tmp_path: Path, joints: str, chain: str, note: str) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(joints))
    said = ran("init", tmp_path / "arm.urdf", "-o", tmp_path)
    for words in (f"arm: {chain} Edit", note, "no link masses"):
        assert words in said
    robot = calib.load_cell(tmp_path / "cell.toml").robot
    assert chain.startswith(f"{robot.dof} joint")
    assert f" from {robot.base} to {robot.tip}: {', '.join(robot.joints)}" in chain


def test_ends_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(KUKA)
    ran("init", tmp_path / "arm.urdf", "-o", tmp_path, "--tip", "link_3")
    assert calib.load_cell(tmp_path / "cell.toml").robot.joints == ("A1", "A2", "A3")


@pytest.mark.long
def test_both_arms_of_a_torso(tmp_path: Path) -> None:
    """The cell that is written is planned for and identified as it is."""
    (tmp_path / "pair.urdf").write_text(two_arms.urdf())
    tips = ("--tip", "right_hand", "--tip", "left_hand")
    said = ran("init", tmp_path / "pair.urdf", "-o", tmp_path, "--base", "base", *tips)
    assert "14 joints from base to right_hand and left_hand" in said
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert cell.robot.tips == ("left_hand", "right_hand")
    assert cell.marker_names == ("m1", "m2", "m3", "left_hand_1", "left_hand_2", "left_hand_3")
    plan = unpolished(cell, poses=14, candidates=120)
    model = build(cell, plan.poses).model
    truth = 0.1 * model.sizes * np.random.default_rng(0).normal(size=len(model.parameters))
    exact = all_seen(plan.poses, model.predict(truth, plan.poses))
    found = calib.identify(replace(cell, size_prior={}), exact)
    np.testing.assert_allclose(found.values, truth, atol=1e-6 * model.sizes.max(), rtol=0)


def init_of_table(folder: Path, table: str = PARALLEL) -> tuple[object, ...]:
    """Words that make a cell of a DH table beside it."""
    (folder / "arm.csv").write_text(table)
    return "init", folder / "arm.csv", "-o", folder, "--dh", "classic"


def test_a_dh_table_has_one_tip(tmp_path: Path) -> None:
    said = refused(*init_of_table(tmp_path), "--tip", "tool", "--tip", "elbow")
    assert "has one tip, and 'elbow' is another" in said


def test_names_that_toml_must_quote(tmp_path: Path) -> None:
    table = PARALLEL.replace("pan,", '"pan ""1"" \u00e9",')
    ran(*init_of_table(tmp_path, table), "--tip", 'the "end"')
    path = tmp_path / "cell.toml"
    text = path.read_text().replace("# [robot.limits_deg]", "[robot.limits_deg]")
    path.write_text(re.sub(r"^# (?=.*\[-180)", "", text, flags=re.M))
    cell = calib.load_cell(path)
    assert cell.robot.joints[0] == 'pan "1" \u00e9'
    assert cell.robot.tip == 'the "end"'
    assert abs(cell.robot.limits).max() < 3.2


def test_nothing_of_the_users_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "measurements.csv").write_text("mine")
    said = refused(*init_of_table(tmp_path))
    assert "measurements.csv: already exists; name another folder by -o" in said
    assert (tmp_path / "measurements.csv").read_text() == "mine"
    assert not (tmp_path / "cell.toml").exists()


# -- A head that watches its hand

EFFECTS = '"base", "tool", "joint_offset"'


@pytest.mark.long
def test_every_command_of_a_day(tmp_path: Path) -> None:
    path = written(tmp_path, PLATE, EYE, effects=EFFECTS)
    plan, table = tmp_path / "plan.csv", tmp_path / "measurements.csv"
    # With an image that is 60 pixels less at each side, so that the plan keeps a reserve.
    (tmp_path / "inner").mkdir()
    inner = EYE.replace("[1280, 960]", "[1160, 840]").replace("[640, 480]", "[580, 420]")
    planned = written(tmp_path / "inner", PLATE, inner, effects=EFFECTS)
    few = ("--poses", 24, "--candidates", 500, "--reapproach", 0)
    ran("design", planned, "-o", plan, *few)
    truth = simulated(path, plan, table)

    found, told = result(tmp_path / "id.json", "identify", path, table, kind="identify")
    off = {p["id"]: abs(p["value"] - truth[p["id"]]) / p["std"] for p in found["parameters"]}
    assert max(off.values()) < 4.5
    (untold,) = found["unidentifiable"]
    assert untold["names"] == [f"joint_offset:{joint}.offset" for joint in COMMON]
    assert "they move nothing that is read against the instrument that reads it" in told

    targets = tmp_path / "targets.csv"
    targets.write_text("".join(plan.read_text().splitlines(keepends=True)[:9]))
    said = ran("compensate", path, tmp_path / "id.json", targets)
    assert "no instrument saw an error of hip, bend" in said
    assert "commands are corrected for right_hand" in said

    ran("report", tmp_path / "id.json", "-o", tmp_path / "report.html")
    assert " on head" in (tmp_path / "report.html").read_text()

    urdf = tmp_path / "better.urdf"
    ran("identify", path, table, "--urdf", urdf)
    assert '"marker_plate:0"' in urdf.read_text()
    assert "marker_head" not in urdf.read_text()

    before = written(tmp_path, PLATE, EYE, effects='"base", "tool"')
    verdict, _ = result(tmp_path / "di.json", "diagnose", before, table, kind="diagnose")
    places = {own["where"] for own in (*verdict["effects"], *verdict["located"])}
    assert places
    assert not places & {*COMMON}


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
