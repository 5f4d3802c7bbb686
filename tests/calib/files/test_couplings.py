"""Joints that others of the robot move together: read from these, planned with them, and corrected.

The oracle places every link of the file by its own product of matrices.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arm.kinematics import forward
from calib.arm.mimic import Coupling, ties_of
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.tables import CouplingTable
from calib.errors import InputError
from calib.files.cell import coupled, load_cell
from calib.files.tables import load_measurements
from calib.files.write_tables import joint_header, measurements_csv
from calib.model.build import build
from calib.poses import poses_at
from tests.helpers import all_seen, cell_of
from tests.plain_arm import frame
from tests.trees import Joint, placed

LEVEL = "[robot.coupled.c]\nof = { a = -1, b = -0.5 }\noffset_deg = 10.0\n"


def chain() -> list[Joint]:
    rng = np.random.default_rng(5)
    joints = []
    for number, name in enumerate("abcdefg"):
        axis, parent = rng.normal(size=3), f"l{number}" if number else "base"
        xyz, rpy, com = rng.uniform(-0.4, 0.4, 3), rng.uniform(-1, 1, 3), rng.normal(size=3) * 0.1
        axis /= np.linalg.norm(axis)
        kind = "prismatic" if name == "g" else "revolute"
        joints.append(Joint(name, kind, parent, f"l{number + 1}", xyz, rpy, axis, 2.0, com))
    return joints


def cell_with(folder: Path, robot: str = LEVEL) -> Cell:
    text = '<robot name="r"><link name="base"/>' + "".join(j.text for j in chain()) + "</robot>"
    (folder / "arm.urdf").write_text(text)
    (folder / "cell.toml").write_text(
        f'schema = 1\n[robot]\nurdf = "arm.urdf"\nbase = "base"\ntip = "l7"\n{robot}'
        "[markers_mm]\nm1 = [50, 20, 30]\n[instrument]\nsigma_mm = 0.01\n"
        '[model]\neffects = ["base", "tool", "geometry"]\n'
    )
    return load_cell(folder / "cell.toml")


def by_hand(a: Array, b: Array) -> Array:
    return -a - 0.5 * b + np.radians(10.0)


def test_those_that_move_it_tell_where_it_is(tmp_path: Path) -> None:
    cell = cell_with(tmp_path)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (4, 7))
    q[:, 2] = by_hand(q[:, 0], q[:, 1])
    text = measurements_csv(cell, all_seen(poses_at(q), np.ones((4, 1, 3))))
    assert "c_deg" not in text.splitlines()[0]
    (tmp_path / "t.csv").write_text(text)
    again = load_measurements(cell, tmp_path / "t.csv").poses.q
    np.testing.assert_allclose(again, q, atol=1e-8)
    tips = forward(cell.robot, again).o[:, -1]
    root = [*chain()]
    root[0] = Joint(**{**root[0].__dict__, "parent": "root"})
    for i, row in enumerate(again):
        expected = placed(root, dict(zip("abcdefg", row, strict=True)))["l7"][:3, 3]
        np.testing.assert_allclose(tips[i], expected, atol=1e-9)
    # A column of its own is used as it is, and is written then.
    q[:, 2] += 0.1
    assert "c_deg" in joint_header(cell.robot, q)


def test_plans_keep_it_where_the_others_put_it(tmp_path: Path) -> None:
    cell = cell_with(tmp_path)
    q = cell.robot.sobol(64)
    np.testing.assert_allclose(q[:, 2], by_hand(q[:, 0], q[:, 1]), atol=1e-12)
    assert cell.robot.free.tolist() == [True, True, False, True, True, True, True]


def test_one_that_follows_one_that_follows() -> None:
    first = Coupling("c", (("a", 2.0), ("b", 1.0)), 0.1)
    ties = ties_of("abcd", (), (Coupling("d", (("c", 3.0),), -0.2), first))
    a, b = 0.4, -0.7
    c = 2.0 * a + b + 0.1
    q = ties.matrix @ [a, b, 9.0, 9.0] + ties.shift
    np.testing.assert_allclose(q, [a, b, c, 3.0 * c - 0.2], atol=1e-15)


def test_errors_of_factors_and_offset_are_identified(tmp_path: Path) -> None:
    """The rod is one per cent longer than designed, and stands wrongly by a milliradian."""
    robot = cell_with(tmp_path).robot
    effects = ("base", "tool", "joint_offset", "joint_coupling:c")
    cell = cell_of(robot, np.array([[0.05, 0.02, 0.03]]), effects)
    q = robot.sobol(80)
    truth = {"from_a": 0.01, "from_b": -0.02, "offset": 1e-3}
    moved = q.copy()
    moved[:, 2] += truth["from_a"] * q[:, 0] + truth["from_b"] * q[:, 1] + truth["offset"]
    model = build(cell, poses_at(q)).model
    own = [p.name for p in model.parameters if p.effect == "joint_coupling"]
    assert own == ["from_a", "from_b"]
    T = np.array([_tip(row) for row in moved])
    points = (T[:, :3, :3] @ cell.markers[0] + T[:, :3, 3])[:, None]
    found = calib.identify(cell, all_seen(poses_at(q), points))
    values = {p.id: v for p, v in zip(found.model.parameters, found.values, strict=True)}
    assert values["joint_coupling:c.from_a"] == pytest.approx(0.01, abs=1e-8)
    assert values["joint_coupling:c.from_b"] == pytest.approx(-0.02, abs=1e-8)
    assert values["joint_offset:c.offset"] == pytest.approx(1e-3, abs=1e-8)


def _tip(q: Array) -> Array:
    T = np.eye(4)
    for joint, value in zip(chain(), q, strict=True):
        slides = joint.kind == "prismatic"
        T = T @ Joint.moved(joint, 0.0)
        T = T @ frame(value * np.concatenate([joint.axis * slides, joint.axis * (not slides)]))
    return T


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"z": {"of": {"a": 1.0}}}, "robot.coupled.z: no such joint"),
        ({"c": {"of": {"z": 1.0}}}, "'of' names 'z' with 1, which moves nothing; name joints that"),
        ({"c": {"of": {"a": 0.0}}}, "'of' names 'a' with 0, which moves nothing"),
        ({"c": {"of": {"c": 1.0}}}, "robot.coupled.c: moves itself, by way of what moves it"),
        (
            {"c": {"of": {"a": 1.0}}, "a": {"of": {"b": 1.0, "c": 2.0}}},
            "robot.coupled.c: moves itself",
        ),
        ({"g": {"of": {"a": 1.0}, "offset_deg": 1.0}}, "robot.coupled.g: the joint slides"),
        ({"c": {"of": {"a": 1.0}, "offset_mm": 1.0}}, "robot.coupled.c: the joint turns; give"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    tmp_path: Path, table: dict[str, dict[str, object]], said: str
) -> None:
    if "z" in table:
        with pytest.raises(InputError, match=said):
            cell_with(tmp_path, LEVEL.replace("coupled.c", "coupled.z"))
        return
    robot = cell_with(tmp_path, "").robot
    own = {joint: CouplingTable.model_validate(entry) for joint, entry in table.items()}
    with pytest.raises(InputError) as error:
        coupled(Path("cell.toml"), robot, own)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
