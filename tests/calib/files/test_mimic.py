"""Joints that mimic another: what tables tell of them, and that all poses that are drawn keep to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.arm.inverse import solutions
from calib.arm.kinematics import forward
from calib.arm.mimic import Mimic
from calib.arm.robot import Robot
from calib.cell.planned import Planned
from calib.cell.targets import sobol_poses
from calib.errors import CalibError, InputError
from calib.files.tables import load_measurements, load_plan
from calib.files.urdf import load_urdf
from calib.files.write_tables import measurements_csv, plan_csv
from calib.model.build import build
from calib.poses import poses_at
from calib.prediction.commands import Goal, reach, tip_of
from doe.candidates import drawn
from studies.command.program import program_text
from tests.helpers import all_seen, cell_of, random_robot
from tests.trees import Joint, placed

MARKERS = np.array([[0.1, 0.0, 0.05], [-0.05, 0.09, 0.05], [-0.05, -0.08, 0.07]])


@pytest.fixture(params=["inside", "outside"])
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Robot, list[Joint]]:
    """A column of two slides and a tilt that follow the lift, and an arm of six on it.

    Inside: the lift is the first joint of the chain; outside: it stands beside it.
    """
    rng = np.random.default_rng(3)
    rows = [("lift", "prismatic"), ("a", "prismatic"), ("b", "revolute")]
    rows += [(f"j{k}", "revolute") for k in range(1, 7)]
    joints, parent = [], "base"
    for name, kind in rows:
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        xyz, rpy, com = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1, 1, 3), rng.normal(size=3) * 0.1
        joint = Joint(name, kind, parent, f"l_{name}", xyz, rpy, axis, 2.0, com)
        joints.append(joint)
        parent = parent if name == "lift" and request.param == "outside" else joint.child
    text = "".join(j.text for j in joints).replace("</joint>", "{}</joint>")
    mimics = ["", '<mimic joint="lift" multiplier="0.5" offset="-0.2"/>',
              '<mimic joint="a" multiplier="-0.5" offset="0.3"/>', *6 * [""]]  # fmt: skip
    text = f'<robot name="r"><link name="base"/>{text.format(*mimics)}</robot>'
    text = text.replace('lower="-2" upper="2"', 'lower="0.1" upper="1.7"', 1)
    (tmp_path / "arm.urdf").write_text(text)
    return load_urdf(tmp_path / "arm.urdf", "base", "l_j6"), joints


def followed(lift: np.ndarray) -> dict[str, np.ndarray]:
    """By hand: b follows a, which follows the lift."""
    a = 0.5 * lift - 0.2
    return {"lift": lift, "a": a, "b": -0.5 * a + 0.3}


def follows(robot: Robot, q: np.ndarray) -> bool:
    a, b = (q[..., robot.joints.index(name)] for name in "ab")
    lift = (a + 0.2) / 0.5
    inside = "lift" not in robot.joints or np.allclose(lift, q[..., 0], atol=1e-9)
    kept = (lift >= 0.1 - 1e-9).all() and (lift <= 1.7 + 1e-9).all()
    return bool(inside and kept and np.allclose(b, -0.5 * a + 0.3, atol=1e-9))


def cell(robot: Robot, effects: Sequence[str] = ("base", "tool", "geometry")) -> Cell:
    return cell_of(robot, MARKERS, effects)


def table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = [",".join(["pose", "marker", *columns, "x_mm", "y_mm", "z_mm"])]
    rows += [
        ",".join([f"p{i}", "m1", *map(repr, map(float, row)), "1", "2", "3"])
        for i, row in enumerate(zip(*columns.values(), strict=True))
    ]
    path.write_text("\n".join(rows))
    return path


def test_the_master_tells_where_they_are(arm: tuple[Robot, list[Joint]], tmp_path: Path) -> None:
    robot, joints = arm
    rng = np.random.default_rng(0)
    lift, turned = rng.uniform(0.1, 1.7, 4), rng.uniform(-1, 1, (4, 6))
    columns = {"lift_mm": lift * 1e3} | {f"j{k + 1}_rad": turned[:, k] for k in range(6)}
    own = load_measurements(cell(robot), table(tmp_path / "t.csv", columns), every_marker=False)
    assert not own.warnings
    tips = forward(robot, own.poses.q).o[:, -1]
    for i in range(4):
        values = {name: value[i] for name, value in followed(lift).items()}
        values |= {f"j{k + 1}": turned[i, k] for k in range(6)}
        expected = placed([replace_root(j) for j in joints], values)["l_j6"][:3, 3]
        np.testing.assert_allclose(tips[i], expected, atol=1e-12)
    # A column of its own is used as it is, and the others follow the master.
    columns["b_deg"] = rng.uniform(5, 10, 4)
    again = load_measurements(cell(robot), table(tmp_path / "t.csv", columns), every_marker=False)
    b = robot.joints.index("b")
    np.testing.assert_allclose(np.degrees(again.poses.q[:, b]), columns["b_deg"], rtol=1e-12)
    rest = [k for k in range(robot.dof) if k != b]
    np.testing.assert_array_equal(again.poses.q[:, rest], own.poses.q[:, rest])


def replace_root(joint: Joint) -> Joint:
    return replace(joint, parent="root") if joint.parent == "base" else joint


def test_without_a_column_one_line_says_what_to_add(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    robot, _ = arm
    columns = {f"j{k + 1}_rad": np.zeros(2) for k in range(6)}
    joint = robot.joints[0]
    said = "joint lift; add lift_mm or lift_m"
    if joint == "a":
        said = "joint a, nor for lift, which it mimics; add lift_mm or lift_m or a_mm or a_m"
    with pytest.raises(InputError, match=f"line 1: no column for {said}$"):
        load_measurements(cell(robot), table(tmp_path / "t.csv", columns))


def test_from_which_side_they_came_is_told_by_the_master(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    robot, _ = arm
    columns = {"lift_m": np.array([0.5, 0.6])} | {f"j{k + 1}_rad": np.zeros(2) for k in range(6)}
    columns |= {"approach_lift": np.array([1.0, -1.0])}
    columns |= {f"approach_j{k + 1}": np.ones(2) for k in range(6)}
    poses = load_measurements(
        cell(robot), table(tmp_path / "t.csv", columns), every_marker=False
    ).poses
    assert poses.approach is not None
    a, b = robot.joints.index("a"), robot.joints.index("b")
    assert poses.approach[:, a].tolist() == [1.0, -1.0]
    assert poses.approach[:, b].tolist() == [-1.0, 1.0], "it turns back as the lift rises"


def test_what_is_drawn_keeps_to_it_and_within_all_limits(arm: tuple[Robot, list[Joint]]) -> None:
    robot, _ = arm
    here = cell(robot)
    assert follows(robot, sobol_poses(here, 50, 0).q)
    assert follows(robot, np.concatenate(list(drawn(here, 200, None, 0))))
    tips = forward(robot, sobol_poses(here, 3, 1).q)
    reference = robot.tied(robot.sample_limits().mean(axis=1))
    for found in solutions(robot, tips.R[:, -1], tips.o[:, -1]):
        assert len(found.q)
        assert all(np.allclose(robot.tied(q), q, atol=1e-9) for q in found.q)
        assert follows(robot, found.nearest(robot, reference))


def test_a_plan_keeps_to_it_and_tells_the_master(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    robot, _ = arm
    here = replace(cell(robot), design=Planned())
    plan = doe.design(here, poses=14, criterion="D", candidates=200)
    assert follows(robot, plan.poses.q)
    text = plan_csv(here, plan.poses)
    joints = ["lift_mm", *(f"j{k}_deg" for k in range(1, 7))]
    assert text.splitlines()[0].split(",")[:8] == ["pose", *joints]
    (tmp_path / "plan.csv").write_text(text)
    np.testing.assert_allclose(load_plan(here, tmp_path / "plan.csv").q, plan.poses.q, atol=1e-9)
    with pytest.raises(InputError, match="6 after them at most, each with a drive"):
        program_text(".src", "p", here, plan.poses, "plan.csv", [])
    lead = robot.joints[0]
    with pytest.raises(CalibError, match=f"levels of b: it moves with {lead}; give levels of"):
        doe.design(here, levels="b=2x3", candidates=100)


def test_measurements_are_written_as_they_were_read(
    arm: tuple[Robot, list[Joint]], tmp_path: Path
) -> None:
    robot, _ = arm
    here = cell(robot)
    q = sobol_poses(here, 5, 0).q
    for shift in (0.0, 1e-3):
        q[:, robot.joints.index("b")] += shift
        built, poses = build(here).model, poses_at(q)
        points = built.predict(built.initial, poses)
        data = all_seen(poses, points)
        text = measurements_csv(here, data)
        assert ("b_deg" in text) is (shift > 0.0)
        (tmp_path / "t.csv").write_text(text)
        again = load_measurements(here, tmp_path / "t.csv")
        np.testing.assert_allclose(again.poses.q, q, atol=1e-9)


def test_constants_that_only_other_ratios_would_tell_are_left_out() -> None:
    """As many as the rank at poses that follow: two slides along one line are read as one."""
    robot = random_robot(np.random.default_rng(5), 6, (0, 1))
    origins, axes = robot.origins.copy(), robot.axes.copy()
    origins[1], axes[1] = np.eye(4), axes[0]
    robot = replace(robot, origins=origins, axes=axes)
    built = build(cell(replace(robot, mimics=(Mimic("j2", "j1", True, 0.8, 0.05),))))
    poses, values = poses_at(sobol_poses(cell(built.model.robot), 60, 2).q), built.full.initial
    J = built.full.jacobian(values, poses)[1].reshape(-1, len(values))
    rank = np.linalg.matrix_rank(J / np.linalg.norm(J, axis=0), tol=1e-6)
    assert len(built.model.parameters) == rank < len(build(cell(robot)).model.parameters)


def test_commands_that_bring_the_arm_there_keep_to_it(arm: tuple[Robot, list[Joint]]) -> None:
    robot, _ = arm
    built = build(cell(robot, ("geometry",))).model
    rng = np.random.default_rng(1)
    values = rng.normal(size=len(built.parameters)) * 1e-3
    targets = poses_at(sobol_poses(cell(robot), 20, 4).q)
    tips = forward(robot, targets.q)
    goal = Goal(tips.R[:, -1], tips.o[:, -1], MARKERS)
    found = reach(built, values, targets, goal)
    met = found.settled & ~found.held.any(axis=1) & (found.lost == 0)
    assert met.sum() > 10
    assert follows(robot, found.q)
    there = tip_of(built, values, replace(targets, q=found.q))
    np.testing.assert_allclose(there.o[met, -1], goal.o[met], atol=1e-8)


def test_the_published_column_and_one_joint_in_its_place_are_identified_alike(
    data: Path, tmp_path: Path
) -> None:
    text = (data / "hilti_column" / "cell.toml").read_text()
    predicted = []
    for name in ("robot.urdf", "mimic.urdf"):
        (tmp_path / name).write_bytes((data / "hilti_column" / name).read_bytes())
        (tmp_path / "cell.toml").write_text(text.replace("robot.urdf", name))
        here = calib.load_cell(tmp_path / "cell.toml")
        readings = calib.load_measurements(here, data / "hilti_column" / "flat.csv")
        assert not readings.warnings
        # The chains differ in joints, and so in what is believed of their errors.
        result = calib.identify(replace(here, size_prior="off"), readings)
        predicted.append(calib.predict(here, readings, result.values))
    np.testing.assert_allclose(*predicted, atol=1e-8)
