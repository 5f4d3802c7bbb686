"""Robots' files: a first cell of them, a head that watches its hand, and a MuJoCo arm calibrated."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib.arm.se3 import fit_rigid, rotate, so3_exp
from calib.arrays import Array
from calib.files.cell import load_cell
from calib.files.cell_out import extended_cell
from calib.files.tables import load_plan
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from studies.demo.embedded import embedded_text
from tests import two_arms
from tests.calib.test_robots import TABLES
from tests.doe.problems import unpolished
from tests.helpers import all_seen
from tests.studies.command_line import result, run
from tests.trees import in_mujoco
from tests.two_arms import COMMON, EYE, PLATE, written

MJCF = """<mujoco model="hand arm"><worldbody>
<body name="base"><geom size="0.1" mass="5"/>
<body name="one" pos="0 0 0.3"><joint name="j1" axis="0 0 1" range="-170 170"/><geom size="0.1"/>
<body name="two" pos="0 0 0.3"><joint name="j2" axis="0 1 0" range="-120 120"/><geom size="0.1"/>
<site name="attachment_site" pos="0 0 0.2"/>
<body name="left"><joint name="f1" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
<body name="right"><joint name="f2" type="slide" axis="0 1 0" range="0 0.04"/><geom size="0.01"/></body>
</body></body></body></worldbody></mujoco>"""


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
    done = run("init", tmp_path / name, "-o", folder, *options, "--json", tmp_path / "out.json")
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
    assert (
        run("init", tmp_path / "arm.csv", "-o", tmp_path / "cell", "--dh", "classic").exit_code == 0
    )
    plan = tmp_path / "plan.csv"
    call = ["design", tmp_path / "cell" / "cell.toml", "--candidates", "500", "-o", plan]
    done = run(*call, "--criterion", "D")
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(tmp_path / "cell" / "cell.toml")
    assert len(calib.load_plan(cell, plan)) == 30


def test_a_repeatability_is_assumed(tmp_path: Path) -> None:
    """As data sheets have it: for 2.7 m an RP of 0.05 to 0.2 mm; of the tip's turn as of joints."""
    (tmp_path / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    assert run("init", tmp_path / "arm.urdf", "-o", tmp_path / "cell").exit_code == 0
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
    done = run("init", tmp_path / "arm.urdf", "-o", tmp_path)
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert (cell.robot.base, cell.robot.tip) == (base, tip)
    assert said in " ".join(done.stdout.split())
    assert "no link masses" in done.stderr


def test_ends_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    done = run("init", tmp_path / "arm.urdf", "-o", tmp_path, "--tip", "link_3")
    assert done.exit_code == 0, done.output
    assert calib.load_cell(tmp_path / "cell.toml").robot.joints == ("A1", "A2", "A3")


@pytest.mark.long
def test_both_arms_of_a_torso(tmp_path: Path) -> None:
    """The cell that is written is planned for and identified as it is."""
    (tmp_path / "pair.urdf").write_text(two_arms.urdf())
    tips = ("--tip", "right_hand", "--tip", "left_hand")
    done = run("init", tmp_path / "pair.urdf", "-o", tmp_path, "--base", "base", *tips)
    assert done.exit_code == 0, done.output
    assert "14 joints from base to right_hand and left_hand" in " ".join(done.stdout.split())
    cell = calib.load_cell(tmp_path / "cell.toml")
    assert cell.robot.tips == ("left_hand", "right_hand")
    assert cell.marker_names == ("m1", "m2", "m3", "left_hand_1", "left_hand_2", "left_hand_3")
    plan = unpolished(cell, poses=14, candidates=120)
    model = build(cell, plan.poses).model
    truth = 0.1 * model.sizes * np.random.default_rng(0).normal(size=len(model.parameters))
    exact = all_seen(plan.poses, model.predict(truth, plan.poses))
    found = calib.identify(replace(cell, size_prior={}), exact)
    np.testing.assert_allclose(found.values, truth, atol=1e-6 * model.sizes.max(), rtol=0)


def test_a_dh_table_has_one_tip(tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(TABLES["three parallel axes"])
    tips = ("--tip", "tool", "--tip", "elbow")
    done = run("init", tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic", *tips)
    assert done.exit_code == 2
    assert "has one tip, and 'elbow' is another" in done.stderr


def test_names_that_toml_must_quote(tmp_path: Path) -> None:
    table = TABLES["three parallel axes"].replace("pan,", 'pan "1" é,').replace("pan ", '"pan ')
    (tmp_path / "arm.csv").write_text(table.replace('"pan "1" é,', '"pan ""1"" é",'))
    done = run(
        "init", tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic", "--tip", 'the "end"'
    )
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
    done = run("init", tmp_path / "arm.csv", "-o", tmp_path, "--dh", "classic")
    assert done.exit_code == 2
    assert "measurements.csv: already exists; name another folder by -o" in done.stderr
    assert (tmp_path / "measurements.csv").read_text() == "mine"
    assert not (tmp_path / "cell.toml").exists()


EFFECTS = '"base", "tool", "joint_offset"'


@pytest.mark.long
def test_every_command_of_a_day(tmp_path: Path) -> None:
    path = written(tmp_path, PLATE, EYE, effects=EFFECTS)
    plan = tmp_path / "plan.csv"
    few = ("--poses", 24, "--candidates", 500, "--reapproach", 0)
    done = run("design", within(tmp_path), "-o", plan, *few)
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


SIGMA = 1e-5  # m

NOMINAL = """<mujoco model="arm">
  <compiler angle="degree" eulerseq="XYZ" autolimits="true"/>
  <default><joint axis="0 1 0" range="-150 150"/></default>
  <worldbody>
    <body name="base">
      <body name="link1" pos="0 0 0.4"><joint name="A1" axis="0 0 1" range="-180 180"/>
        <inertial pos="0 0 0.1" mass="30" diaginertia="1 1 1"/>
        <frame pos="0.15 0 0.2" euler="0 20 0">
          <body name="link2"><joint name="A2" ref="20"/>
            <inertial pos="0 0 0.3" mass="20" diaginertia="1 1 1"/>
            <body name="wrist" pos="0.02 0 0.7" euler="0 90 0">
              <joint name="A3"/><joint name="A4" axis="0 0 1" pos="0 0.03 0"/>
              <inertial pos="0 0 0.2" mass="10" diaginertia="1 1 1"/>
              <body name="link5" pos="0 0 0.6"><joint name="A5"/>
                <inertial pos="0 0 0.02" mass="3" diaginertia="1 1 1"/>
                <body name="hand" pos="0 0 0.08"><joint name="A6" axis="0 0 1"/>
                  <inertial pos="0 0 0.02" mass="1" diaginertia="1 1 1"/>
                  <site name="flange" pos="0 0 0.05" euler="0 0 45"/>
                </body>
              </body>
            </body>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

MJCF_CELL = """schema = 1
name = "arm"
[robot]
mjcf = "model/scene.xml"
base = "base"
tip = "flange"
[markers_mm]
m1 = [100, 0, 30]
m2 = [-50, 90, 60]
m3 = [-40, -80, 100]
[instrument]
sigma_mm = 0.010
[model]
effects = ["base", "tool", "geometry"]
"""

MARKERS = np.array([[0.1, 0.0, 0.03], [-0.05, 0.09, 0.06], [-0.04, -0.08, 0.1]])


def perturbed(rng: np.random.Generator) -> str:
    """The true arm: every number that places something is off, and its markers are sites."""

    def off(match: re.Match[str]) -> str:
        size = {"pos": 1e-3, "axis": 1e-3, "euler": 0.05, "ref": 0.1}[match[1]]
        values = np.array(match[2].split(), dtype=float)
        return f'{match[1]}="{words(values + size * rng.normal(size=len(values)))}"'

    text = NOMINAL.replace('name="A3"', 'name="A3" axis="0 1 0" pos="0 0 0"')
    text = text.replace('<body name="link2">', '<body name="link2" pos="0 0 0" euler="0 0 0">')
    text = re.sub(r'(?<= )(pos|axis|euler|ref)="([^"]*)"', off, text)
    return with_markers(text, MARKERS + 1e-3 * rng.normal(size=(3, 3)))


def with_markers(text: str, tool: Array) -> str:
    """Sites m1 .. in the axes of the flange."""
    flange = re.search(r'<site name="flange" (.*)/>', text)
    assert flange is not None
    marks = "".join(f'<site name="m{j + 1}" pos="{words(p)}"/>' for j, p in enumerate(tool))
    return text.replace(flange[0], f"<frame {flange[1]}>{marks}</frame>")


def words(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def sites(model: mujoco.MjModel, names: list[str], q: Array) -> Array:
    """Shape (poses, markers, 3), m."""
    return places(model, "site", names, q)


def places(model: Any, kind: str, names: list[str], q: Array) -> Array:
    """Of sites or bodies, shape (poses, markers, 3), m."""
    data = mujoco.MjData(model)
    found = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        found.append([getattr(data, kind)(name).xpos.copy() for name in names])
    return np.array(found)


def table(q: Array, points: Array) -> str:
    joints = ",".join(f"A{k + 1}_deg" for k in range(q.shape[1]))
    lines = [f"pose,marker,{joints},x_mm,y_mm,z_mm"]
    for i, (row, seen) in enumerate(zip(np.degrees(q), points * 1e3, strict=True)):
        for j, point in enumerate(seen):
            lines.append(f"p{i},m{j + 1},{','.join(repr(float(v)) for v in (*row, *point))}")
    return "\n".join([*lines, ""])


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


class Calibrated:
    """A truth in MuJoCo, measured, identified from the nominal file, and written back."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(11)
        self.folder = folder
        (folder / "model").mkdir()
        (folder / "model" / "arm.xml").write_text(NOMINAL)
        (folder / "model" / "scene.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
        (folder / "cell.toml").write_text(MJCF_CELL)
        truth = mujoco.MjModel.from_xml_string(perturbed(rng))
        R, p = so3_exp(np.array([0.3, -0.2, 1.1])), np.array([3.0, 1.0, -0.5])
        q = rng.uniform(-1.6, 1.6, (70, 6))
        readings = rotate(R, sites(truth, ["m1", "m2", "m3"], q)) + p
        self.new, self.true = q[40:], readings[40:]
        noisy = readings[:40] + SIGMA * rng.normal(size=(40, 3, 3))
        (folder / "measurements.csv").write_text(table(q[:40], noisy))
        self.said = run(
            *("identify", folder / "cell.toml", folder / "measurements.csv"),
            *("--urdf", folder / "better.urdf", "--json", folder / "result.json"),
        )
        assert self.said.exit_code == 0, self.said.output
        self.result: dict[str, Any] = json.loads((folder / "result.json").read_text())

    def gap(self, text: str) -> float:
        """What MuJoCo's markers miss the truth by at the new poses, placed as identified."""
        names = ["marker_m1", "marker_m2", "marker_m3"]
        found = places(in_mujoco(text), "body", names, self.new)
        base = self.result["base"]
        R = so3_exp(np.array(base["rotation_vector_rad"]))
        return rms(rotate(R, found) + np.array(base["translation_mm"]) / 1e3 - self.true)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    return Calibrated(tmp_path_factory.mktemp("mjcf"))


def test_the_users_simulator_shows_the_smaller_gap(calibrated: Calibrated) -> None:
    nominal = mujoco.MjModel.from_xml_string(with_markers(NOMINAL, MARKERS))
    found = sites(nominal, ["m1", "m2", "m3"], calibrated.new)
    T = fit_rigid(calibrated.true.reshape(-1, 3), found.reshape(-1, 3))
    before = rms(rotate(T[:3, :3], found) + T[:3, 3] - calibrated.true)
    after = calibrated.gap((calibrated.folder / "better.urdf").read_text())
    print(
        f"MuJoCo's markers off the truth at new poses: {before * 1e3:.4f} -> {after * 1e3:.4f} mm"
    )
    assert calibrated.result["status"] == "converged"
    assert before > 2e-3
    assert after < np.sqrt(3.0) * SIGMA, "below the noise of the readings"


def test_results_name_every_file_of_the_robot(calibrated: Calibrated) -> None:
    names = [Path(entry["file"]).name for entry in calibrated.result["inputs"]]
    assert names == ["cell.toml", "scene.xml", "arm.xml", "measurements.csv"]
    folder = calibrated.folder
    arm = folder / "model" / "arm.xml"
    done = run("identify", folder / "cell.toml", folder / "measurements.csv", "--urdf", arm)
    assert done.exit_code == 2
    assert "arm.xml: is already an input" in done.stderr
    assert arm.read_text() == NOMINAL


def test_what_a_rigid_robot_cannot_hold_is_said(calibrated: Calibrated) -> None:
    folder = calibrated.folder
    effects = 'effects = ["base", "tool", "geometry", "joint_compliance:A2,A3"]'
    (folder / "soft.toml").write_text(re.sub(r"effects = .*", effects, MJCF_CELL))
    done = run(
        *("identify", folder / "soft.toml", folder / "measurements.csv"),
        *("--urdf", folder / "soft.urdf"),
    )
    assert done.exit_code == 0, done.output
    assert "rigid, without joint_compliance:A2, joint_compliance:A3" in done.stdout
    assert "rigid" not in calibrated.said.output
    said = "better.urdf is made anew from the MJCF: the bare chain, without"
    assert said in calibrated.said.stdout


def test_a_cell_elsewhere_finds_its_mjcf(calibrated: Calibrated, tmp_path: Path) -> None:
    cell = calib.load_cell(calibrated.folder / "cell.toml")
    data = calib.load_measurements(cell, calibrated.folder / "measurements.csv")
    target = tmp_path / "cell.toml"
    target.write_text(extended_cell(cell, [], data.poses, target).text)
    again = calib.load_cell(target)
    assert [f.resolve() for f in again.robot_files] == [f.resolve() for f in cell.robot_files]
