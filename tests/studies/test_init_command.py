"""``posecal init``: from a robot's file to a cell that can be planned with at once."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import calib
import doe
from calib.model.build import build
from studies.demo.embedded import embedded_text
from tests import two_arms
from tests.calib.test_robots import TABLES
from tests.helpers import all_seen
from tests.studies.command_line import run as posecal

MJCF = """<mujoco model="hand arm"><worldbody>
<body name="base"><geom size="0.1" mass="5"/>
<body name="one" pos="0 0 0.3"><joint name="j1" axis="0 0 1" range="-170 170"/><geom size="0.1"/>
<body name="two" pos="0 0 0.3"><joint name="j2" axis="0 1 0" range="-120 120"/><geom size="0.1"/>
<site name="attachment_site" pos="0 0 0.2"/>
<body name="left"><joint name="f1" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
<body name="right"><joint name="f2" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
</body></body></body></worldbody></mujoco>"""


init = partial(posecal, "init")


def urdf(joints: str) -> str:
    """Joints as ``parent>child:name:type``, links from them."""
    parts = [part.replace(">", ":").split(":") for part in joints.split()]
    links = dict.fromkeys(name for parent, child, _, _ in parts for name in (parent, child))
    texts = [f'<link name="{name}"/>' for name in links]
    for parent, child, name, kind in parts:
        mimic = '<mimic joint="x"/>' if kind == "mimic" else ""
        kind = "prismatic" if kind == "mimic" else kind
        texts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>{mimic}</joint>'
        )
    return f'<robot name="arm">{"".join(texts)}</robot>'


FILES = {
    "arm.urdf": (embedded_text("kr270.urdf"), (), "base_link", "tool0"),
    "arm.xml": (MJCF, (), "base", "attachment_site"),
    "arm.csv": (TABLES["three parallel axes"], ("--dh", "classic"), "base", "tip"),
    "scara.csv": (TABLES["a SCARA in other units"], ("--dh", "modified"), "base", "tip"),
}


@pytest.mark.parametrize("name", FILES)
def test_the_cell_loads_and_the_table_fits_it(tmp_path: Path, name: str) -> None:
    text, options, base, tip = FILES[name]
    (tmp_path / name).write_text(text)
    folder = tmp_path / "new" / "cell"
    done = init(tmp_path / name, "-o", folder, *options, "--json", tmp_path / "out.json")
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(folder / "cell.toml")
    assert (cell.robot.base, cell.robot.tip) == (base, tip)
    header = (folder / "measurements.csv").read_text().strip().split(",")
    assert header[:2] == ["pose", "marker"]
    assert header[-3:] == ["x_mm", "y_mm", "z_mm"]
    units = ["mm" if slides else "deg" for slides in cell.robot.prismatic]
    assert header[2:-3] == [f"{j}_{u}" for j, u in zip(cell.robot.joints, units, strict=True)]
    example = ",".join(["p1", "m1", *("1" for _ in cell.robot.joints), "1,2,3"])
    (folder / "measurements.csv").write_text(",".join(header) + f"\n{example}\n")
    assert len(calib.load_measurements(cell, folder / "measurements.csv", every_marker=False)) == 1
    said = json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)
    assert said["command"] == "init"
    assert said["robot"] == {"form": cell.robot.source.form, "base": base, "tip": tip}
    assert any("no limits" in w for w in said["warnings"]) is (name not in ("arm.urdf", "arm.xml"))
    assert any("no link masses" in w for w in said["warnings"]) is (
        name not in ("arm.urdf", "arm.xml")
    )
    assert all(f"warning: {w}" in done.stderr for w in said["warnings"])


@pytest.mark.long
def test_it_can_be_planned_with_at_once(tmp_path: Path) -> None:
    rows = TABLES["three parallel axes"].split("\n")
    (tmp_path / "arm.csv").write_text("\n".join(rows[:3]))
    assert init(tmp_path / "arm.csv", "-o", tmp_path / "cell", "--dh", "classic").exit_code == 0
    plan = tmp_path / "plan.csv"
    call = ["design", tmp_path / "cell" / "cell.toml", "--candidates", "500", "-o", plan]
    done = posecal(*call, "--criterion", "D")
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(tmp_path / "cell" / "cell.toml")
    assert len(calib.load_plan(cell, plan)) == 30


def test_a_repeatability_is_assumed(tmp_path: Path) -> None:
    """As data sheets have it: for 2.7 m an RP of 0.05 to 0.2 mm; of the tip's turn as of joints."""
    (tmp_path / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    assert init(tmp_path / "arm.urdf", "-o", tmp_path / "cell").exit_code == 0
    path = tmp_path / "cell" / "cell.toml"
    assert path.read_text().count("# assumed: ") == 2
    found = calib.load_cell(path).repeatability
    assert found is not None
    assert 0.05e-3 < 3.6 * found.translation < 0.2e-3
    assert 0.5 < found.translation / found.rotation < 3.0  # m, half of the arm


@pytest.mark.parametrize(
    ("joints", "base", "tip", "said"),
    [
        ("world>arm:w:fixed arm>l1:a:revolute l1>l2:b:revolute", "arm", "l2", ""),
        (
            "base_link>l1:a:revolute l1>l2:b:revolute l2>hand:h:fixed hand>tcp:t:fixed "
            "hand>f1:fa:prismatic hand>f2:fb:mimic",
            "base_link",
            "tcp",
            "2 joints from base_link to tcp: a, b; held at zero: fa, fb",
        ),
        (
            "torso>l1:a:revolute l1>l2:b:revolute l2>tool0:t:fixed torso>head:h:revolute "
            "cart>torso:c:fixed cart>wheel:w:continuous",
            "torso",
            "tool0",
            "2 joints from torso to tool0: a, b; held at zero: h, w",
        ),
        (
            "base_link>lift:t:prismatic lift>h1:h:revolute h1>h2:i:revolute lift>l1:a:revolute "
            "l1>l2:b:revolute l2>l3:c:revolute l3>tool:x:fixed tool>f1:f:prismatic "
            "tool>f2:g:prismatic base_link>wheel:w:continuous",
            "base_link",
            "tool",
            "4 joints from base_link to tool: t, a, b, c; held at zero: h, i, f, g, w",
        ),
        (
            "torso>l1:a:revolute l1>l2:b:revolute torso>r1:c:revolute r1>r2:d:revolute",
            "torso",
            "l2",
            "arms of one length part at 'torso': took that of 'l1', not of 'r1'; --tip takes another; "
            "one --tip for each takes all",
        ),
        ("b>l1:a:revolute l1>flange:f:fixed flange>my_tool:t:fixed", "b", "my_tool", ""),
        (
            "b>l1:pan:revolute l1>gripper_link:wrist_roll:revolute gripper_link>frame:f:fixed "
            "gripper_link>moving_jaw:gripper:revolute",
            "b",
            "gripper_link",
            "gripper moves a gripper and is left out. To include it: --tip moving_jaw",
        ),
        (
            "b>l1:joint1:revolute l1>stator:s:fixed stator>mover:jointGripper:revolute",
            "b",
            "stator",
            "1 joint from b to stator: joint1; held at zero: jointGripper",
        ),
        (
            "b>l1:a:revolute l1>ft:b:fixed ft>drive:gripper_left_joint:revolute "
            "drive>finger:inner_single_joint:revolute",
            "b",
            "ft",
            "gripper_left_joint, inner_single_joint moves a gripper and is left out",
        ),
        ("b>l1:a:revolute l1>hand:HandYaw:revolute", "b", "hand", "2 joints from b to hand"),
        ("b>l1:finger_1:revolute l1>l2:finger_2:revolute", "b", "l2", "2 joints from b to l2"),
    ],
)
def test_where_an_arm_begins_and_ends(
    tmp_path: Path, joints: str, base: str, tip: str, said: str
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(joints))
    done = init(tmp_path / "arm.urdf", "-o", tmp_path)
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert (cell.robot.base, cell.robot.tip) == (base, tip)
    assert said in " ".join(done.stdout.split())
    assert "no link masses" in done.stderr


def test_ends_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    done = init(tmp_path / "arm.urdf", "-o", tmp_path, "--tip", "link_3")
    assert done.exit_code == 0, done.output
    assert calib.load_cell(tmp_path / "cell.toml").robot.joints == ("A1", "A2", "A3")


def test_both_arms_of_a_torso(tmp_path: Path) -> None:
    """The cell that is written is planned for and identified as it is."""
    (tmp_path / "pair.urdf").write_text(two_arms.urdf())
    tips = ("--tip", "right_hand", "--tip", "left_hand")
    done = init(tmp_path / "pair.urdf", "-o", tmp_path, "--base", "base", *tips)
    assert done.exit_code == 0, done.output
    assert "14 joints from base to right_hand and left_hand" in " ".join(done.stdout.split())
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert cell.robot.tips == ("left_hand", "right_hand")
    assert cell.marker_names == ("m1", "m2", "m3", "left_hand_1", "left_hand_2", "left_hand_3")
    plan = doe.design(cell, poses=14, candidates=300)
    model = build(cell, plan.poses).model
    truth = 0.1 * model.sizes * np.random.default_rng(0).normal(size=len(model.parameters))
    exact = all_seen(plan.poses, model.predict(truth, plan.poses))
    found = calib.identify(replace(cell, size_prior={}), exact)
    np.testing.assert_allclose(found.values, truth, atol=1e-6 * model.sizes.max(), rtol=0)


def test_a_dh_table_has_one_tip(tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(TABLES["three parallel axes"])
    tips = ("--tip", "tool", "--tip", "elbow")
    done = init(tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic", *tips)
    assert done.exit_code == 2
    assert "has one tip, and 'elbow' is another" in done.stderr


def test_names_that_toml_must_quote(tmp_path: Path) -> None:
    table = TABLES["three parallel axes"].replace("pan,", 'pan "1" é,').replace("pan ", '"pan ')
    (tmp_path / "arm.csv").write_text(table.replace('"pan "1" é,', '"pan ""1"" é",'))
    done = init(tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic", "--tip", 'the "end"')
    assert done.exit_code == 0, done.output
    text = (tmp_path / "cell.toml").read_text()
    (tmp_path / "cell.toml").write_text(
        "\n".join(line.removeprefix("# ") if "[-180" in line else line for line in text.split("\n"))
        .replace("# [robot.limits_deg]", "[robot.limits_deg]")
    )  # fmt: skip
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert cell.robot.joints[0] == 'pan "1" é'
    assert cell.robot.tip == 'the "end"'
    assert abs(cell.robot.limits).max() < 3.2


def test_nothing_of_the_users_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(TABLES["three parallel axes"])
    (tmp_path / "measurements.csv").write_text("mine")
    done = init(tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic")
    assert done.exit_code == 2
    assert "measurements.csv: already exists; name another folder by -o" in done.stderr
    assert (tmp_path / "measurements.csv").read_text() == "mine"
    assert not (tmp_path / "cell.toml").exists()
