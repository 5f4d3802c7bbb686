"""Joints that mimic another or are coupled: what tables tell of them, and that all poses keep to it.

The oracle places every link of the file by its own product of matrices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.ties import Coupling, ties_of
from calib.arrays import Array
from calib.cell.planned import Planned
from calib.cell.tables import CouplingTable
from calib.errors import CalibError, InputError
from calib.files.cell import coupled, load_cell
from calib.files.tables import load_measurements, load_plan
from calib.files.urdf import load_urdf
from calib.files.write_tables import measurements_csv, plan_csv
from calib.model.build import build
from calib.poses import poses_at
from calib.prediction.commands import Goal, reach, tip_of
from doe.candidates import drawn
from studies.command.program import program_text
from tests.helpers import all_seen, cell_of, cell_text, random_robot
from tests.trees import Joint, chain, placed, urdf

MARKERS = np.array([[0.1, 0.0, 0.05], [-0.05, 0.09, 0.05], [-0.05, -0.08, 0.07]])


def at(joints: list[Joint], link: str, values: Mapping[str, float]) -> Array:
    """Where a link stands, (3,), m, of joints with these values."""
    return placed(joints, values)[link][:3, 3]


# -- A column of two slides and a tilt that follow the lift, and an arm of six on it


@pytest.fixture(params=["inside", "outside"])
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Robot, list[Joint]]:
    """Inside: the lift is the first joint of the chain; outside: it stands beside it."""
    kinds = {"lift": "prismatic", "a": "prismatic", "b": "revolute"}
    kinds |= {f"j{k}": "revolute" for k in range(1, 7)}
    joints = chain(np.random.default_rng(3), kinds)
    if request.param == "outside":
        joints[1] = replace(joints[1], parent="root")
    mimics = {
        "a": 'joint="lift" multiplier="0.5" offset="-0.2"',
        "b": 'joint="a" multiplier="-0.5" offset="0.3"',
    }
    text = urdf(joints).replace('lower="-2" upper="2"', 'lower="0.1" upper="1.7"', 1)
    for name, of in mimics.items():
        start = f'<joint name="{name}" type="{kinds[name]}">'
        text = text.replace(start, f"{start}<mimic {of}/>")
    (tmp_path / "arm.urdf").write_text(text)
    return load_urdf(tmp_path / "arm.urdf", "root", "l_j6"), joints


def follows(robot: Robot, q: Array) -> bool:
    """By hand: b follows a, which follows the lift."""
    lift, a, b = (q[..., robot.joints.index(name)] for name in ("lift", "a", "b"))
    moved = np.allclose(a, 0.5 * lift - 0.2, atol=1e-9)
    kept = (lift >= 0.1 - 1e-9).all() and (lift <= 1.7 + 1e-9).all()
    return bool(moved and kept and np.allclose(b, -0.5 * a + 0.3, atol=1e-9))


def cell(robot: Robot, effects: Sequence[str] = ("base", "tool", "geometry")) -> Cell:
    return cell_of(robot, MARKERS, effects)


def loaded(robot: Robot, path: Path, columns: Mapping[str, Array]) -> calib.Measurements:
    """Columns through a table of one marker."""
    rows = [",".join(["pose", "marker", *columns, "x_mm", "y_mm", "z_mm"])]
    for i, row in enumerate(zip(*columns.values(), strict=True)):
        rows.append(",".join([f"p{i}", "m1", *map(repr, map(float, row)), "1", "2", "3"]))
    path.write_text("\n".join(rows))
    return load_measurements(cell(robot), path, every_marker=False)


def turns(q: Array) -> dict[str, Array]:
    return {f"j{k}_rad": own for k, own in enumerate(np.transpose(q), 1)}


def test_the_master_tells_where_they_are(arm: tuple[Robot, list[Joint]], tmp_path: Path) -> None:
    robot, joints = arm
    rng, path = np.random.default_rng(0), tmp_path / "t.csv"
    lift, turned = rng.uniform(0.1, 1.7, 4), rng.uniform(-1, 1, (4, 6))
    columns = {"lift_mm": lift * 1e3} | turns(turned)
    own = loaded(robot, path, columns)
    assert not own.warnings
    tips = forward(robot, own.poses.q).o[:, -1]
    for i in range(4):
        a = 0.5 * lift[i] - 0.2
        values = {"lift": lift[i], "a": a, "b": -0.5 * a + 0.3}
        values |= {f"j{k}": x for k, x in enumerate(turned[i], 1)}
        np.testing.assert_allclose(tips[i], at(joints, "l_j6", values), atol=1e-12)
    # A column of its own is used as it is, and the others follow the master.
    again = loaded(robot, path, columns | {"b_deg": rng.uniform(5, 10, 4)}).poses.q
    b = robot.joints.index("b")
    assert (np.degrees(again[:, b]) > 4.9).all()
    rest = [k for k in range(robot.dof) if k != b]
    np.testing.assert_array_equal(again[:, rest], own.poses.q[:, rest])
    # From which side they came is told by the master, too: b turns back as the lift rises.
    sides = {"approach_lift": np.array([1.0, -1.0, 1.0, 1.0])}
    sides |= {f"approach_j{k}": np.ones(4) for k in range(1, 7)}
    approach = loaded(robot, path, columns | sides).poses.approach
    np.testing.assert_array_equal(approach[:, robot.joints.index("a")], [1, -1, 1, 1])
    np.testing.assert_array_equal(approach[:, b], [-1, 1, -1, -1])


def test_without_a_column_one_line_says_what_to_add(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    robot, _ = arm
    said = "joint lift; add lift_mm or lift_m"
    with pytest.raises(InputError, match=f"line 1: no column for {said}$"):
        loaded(robot, tmp_path / "t.csv", turns(np.zeros((2, 6))))


def test_what_is_drawn_and_planned_keeps_to_it(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    """And within all limits; a table of a plan tells the master."""
    robot, _ = arm
    here = replace(cell(robot), design=Planned())
    assert follows(robot, here.robot.sobol(50))
    assert follows(robot, np.concatenate(list(drawn(here, 200, None, 0))))
    plan = doe.design(here, poses=14, criterion="D", candidates=100)
    assert follows(robot, plan.poses.q)
    text = plan_csv(here, plan.poses)
    joints = {"lift_mm", *(f"j{k}_deg" for k in range(1, 7))}
    assert {*text.splitlines()[0].split(",")[:8]} == {"pose"} | joints
    (tmp_path / "plan.csv").write_text(text)
    np.testing.assert_allclose(load_plan(here, tmp_path / "plan.csv").q, plan.poses.q, atol=1e-9)
    with pytest.raises(InputError, match="6 after them at most, each with a drive"):
        program_text(".src", "p", here, plan.poses, "plan.csv", [])
    with pytest.raises(CalibError, match="levels of b: it moves with lift; give levels of"):
        doe.design(here, levels="b=2x3", candidates=100)


def test_constants_that_only_other_ratios_would_tell_are_left_out() -> None:
    """As many as the rank at poses that follow: two slides along one line are read as one."""
    robot = random_robot(np.random.default_rng(5), 6, (0, 1))
    origins, axes = robot.origins.copy(), robot.axes.copy()
    origins[1], axes[1] = np.eye(4), axes[0]
    robot = replace(robot, origins=origins, axes=axes)
    built = build(cell(replace(robot, couplings=(Coupling("j2", (("j1", 0.8),), 0.05),))))
    poses, values = poses_at(built.model.robot.sobol(60, 2)), built.full.initial
    J = built.full.jacobian(values, poses_at(poses.q))[1].reshape(-1, len(values))
    rank = np.linalg.matrix_rank(J / np.linalg.norm(J, axis=0), tol=1e-6)
    assert len(built.model.parameters) == rank < len(build(cell(robot)).model.parameters)


def test_commands_that_bring_the_arm_there_keep_to_it(arm: tuple[Robot, list[Joint]]) -> None:
    robot, _ = arm
    model = build(cell(robot, ("geometry",))).model
    values = np.random.default_rng(1).normal(size=len(model.parameters)) * 1e-3
    targets = poses_at(robot.sobol(20, 4))
    tips = forward(robot, targets.q)
    goal = Goal(tips.R[:, -1], tips.o[:, -1], MARKERS)
    found = reach(model, values, targets, goal)
    met = found.settled & ~found.held.any(axis=1) & (found.lost == 0)
    assert met.sum() > 10
    assert follows(robot, found.q)
    there = tip_of(model, values, replace(targets, q=found.q))
    np.testing.assert_allclose(there.o[met, -1], goal.o[met], atol=1e-8)


def test_the_published_column_and_one_joint_in_its_place_are_identified_alike(
    data: Path, tmp_path: Path
) -> None:
    text = (data / "hilti_column" / "cell.toml").read_text()
    predicted = []
    for name in ("robot.urdf", "mimic.urdf"):
        (tmp_path / name).write_bytes((data / "hilti_column" / name).read_bytes())
        (tmp_path / "cell.toml").write_text(text.replace("robot.urdf", name))
        # The chains differ in joints, and so in what is believed of their errors.
        here = replace(calib.load_cell(tmp_path / "cell.toml"), size_prior="off")
        readings = calib.load_measurements(here, data / "hilti_column" / "flat.csv")
        assert not readings.warnings
        predicted.append(calib.predict(here, readings, calib.identify(here, readings).values))
    np.testing.assert_allclose(*predicted, atol=1e-8)


# -- A joint that two others move

LEVEL = "[robot.coupled.c]\nof = { a = -1, b = -0.5 }\noffset_deg = 10.0\n"
SEVEN = chain(np.random.default_rng(5), dict.fromkeys("abcdef", "revolute") | {"g": "prismatic"})


def coupled_cell(folder: Path, tables: str = LEVEL) -> Cell:
    (folder / "arm.urdf").write_text(urdf(SEVEN))
    robot = 'urdf = "arm.urdf"\nbase = "root"\ntip = "l_g"\n'
    (folder / "cell.toml").write_text(cell_text(robot + tables))
    return load_cell(folder / "cell.toml")


def test_those_that_move_it_tell_where_it_is(tmp_path: Path) -> None:
    """In tables, and in what is drawn."""
    here = coupled_cell(tmp_path)
    q = here.robot.sobol(64)
    by_hand = -q[:, 0] - 0.5 * q[:, 1] + np.radians(10.0)
    np.testing.assert_allclose(q[:, 2], by_hand, atol=1e-12)
    assert here.robot.free.tolist() == [True, True, False, True, True, True, True]
    text = measurements_csv(here, all_seen(poses_at(q), np.ones((64, 1, 3))))
    assert "c_deg" not in text.splitlines()[0]
    (tmp_path / "t.csv").write_text(text)
    again = load_measurements(here, tmp_path / "t.csv").poses.q
    np.testing.assert_allclose(again, q, atol=1e-8)
    for tip, row in zip(forward(here.robot, again).o[:4, -1], again, strict=False):
        expected = at(SEVEN, "l_g", dict(zip("abcdefg", row, strict=True)))
        np.testing.assert_allclose(tip, expected, atol=1e-9)
    # A column of its own is used as it is, and is written then.
    q[:, 2] += 0.1
    text = measurements_csv(here, all_seen(poses_at(q), np.ones((64, 1, 3))))
    assert "c_deg" in text.splitlines()[0]
    (tmp_path / "t.csv").write_text(text)
    np.testing.assert_allclose(load_measurements(here, tmp_path / "t.csv").poses.q, q, atol=1e-8)


def test_one_that_follows_one_that_follows() -> None:
    first = Coupling("c", (("a", 2.0), ("b", 1.0)), 0.1)
    ties = ties_of("abcd", (Coupling("d", (("c", 3.0),), -0.2), first))
    q = ties.matrix @ [0.4, -0.7, 9.0, 9.0] + ties.shift
    np.testing.assert_allclose(q, [0.4, -0.7, 0.2, 0.4], atol=1e-15)


def test_errors_of_factors_and_offset_are_identified(tmp_path: Path) -> None:
    """The rod is one per cent longer than designed, and stands wrongly by a milliradian."""
    robot = coupled_cell(tmp_path).robot
    effects = ("base", "tool", "joint_offset", "joint_coupling:c")
    here, q = cell_of(robot, np.zeros((1, 3)), effects), robot.sobol(25)
    moved = q.copy()
    moved[:, 2] += 0.01 * q[:, 0] - 0.02 * q[:, 1] + 1e-3
    points = [at(SEVEN, "l_g", dict(zip("abcdefg", row, strict=True))) for row in moved]
    found = calib.identify(here, all_seen(poses_at(q), np.array(points)[:, None]))
    values = {p.id: v for p, v in zip(found.model.parameters, found.values, strict=True)}
    own = {name: v for name, v in values.items() if name.startswith("joint_coupling")}
    own |= {"offset": values["joint_offset:c.offset"]}
    assert own == {
        "joint_coupling:c.from_a": pytest.approx(0.01, abs=1e-8),
        "joint_coupling:c.from_b": pytest.approx(-0.02, abs=1e-8),
        "offset": pytest.approx(1e-3, abs=1e-8),
    }


OF_A: dict[str, object] = {"of": {"a": 1.0}}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"c": {"of": {"z": 1.0}}}, "'of' names 'z' with 1, which moves nothing; name joints that"),
        ({"c": {"of": {"a": 0.0}}}, "'of' names 'a' with 0, which moves nothing"),
        ({"c": OF_A, "a": {"of": {"b": 1.0, "c": 2.0}}}, "robot.coupled.c: moves itself"),
        ({"g": OF_A | {"offset_deg": 1.0}}, "robot.coupled.g: the joint slides"),
        ({"c": OF_A | {"offset_mm": 1.0}}, "robot.coupled.c: the joint turns; give"),
    ],
)
def test_what_cannot_be_coupled_is_said_in_one_line(
    tmp_path: Path, table: dict[str, dict[str, object]], said: str
) -> None:
    robot = coupled_cell(tmp_path, "").robot
    own = {joint: CouplingTable.model_validate(entry) for joint, entry in table.items()}
    with pytest.raises(InputError) as error:
        coupled(Path("cell.toml"), robot, own)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
