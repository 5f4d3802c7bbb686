"""Files of motions: the robot that is written against MuJoCo and Pinocchio, the cell, and bags."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

import calib
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.errors import InputError
from calib.files.bag import read_bag
from calib.files.cell_out import cell_with_terms
from calib.files.motion_out import own_links, robot_with
from calib.files.motions import load_motions
from calib.motion.diagnose import MotionDiagnosis, diagnose_motions
from calib.motion.effects import PAYLOAD
from calib.motion.fit import sizes_of
from calib.motion.held import Held, held_by_file
from calib.motion.physical import physical, pseudo_inertias
from calib.motion.regressor import nominal_inertials, regressor
from tests.calib.test_motion import arm, day, diagnosed, fourier, real_cell, torques, written
from tests.studies.command_line import run

TRUTH = {"j2": 'armature=".6" damping="4"', "j1": 'frictionloss="2"', "mass": 7.5}


class Written(NamedTuple):
    """What runs say of an arm, the nearest set of bodies, and its links in all, (n, 10)."""

    result: MotionDiagnosis
    held: Held
    links: Array

    @classmethod
    def of(cls, result: MotionDiagnosis) -> Written:
        held = held_by_file(result, own_links(result.cell.robot)[0])
        return cls(result, held, nominal_inertials(result.cell.robot) + held.links)

    def file(self, form: str, path: Path) -> tuple[str, ...]:
        """Write it; what the form lacks."""
        made = robot_with(self.result.cell, self.held, form, path)
        path.write_text(made.text)
        return made.lacks

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """By hand, of links, damping and armature: dry friction apart, all of inverse dynamics."""
        cell, losses = self.result.cell, self.held.losses
        rigid = regressor(cell.robot, q, v, a, cell.gravity) @ self.links.ravel()
        return np.asarray(rigid + losses[:, 0] * v + losses[:, 2] * a)

    def is_what_mujoco_reads(self, path: Path, seed: int) -> None:
        """Its inverse dynamics at a motion that took no part; every mass is one of a body."""
        self.file("mjcf", path)
        _, q, v, a = fourier(np.random.default_rng(seed), len(self.links))
        expected = self.torques(q, v, a) + self.held.losses[:, 1] * np.sign(v)
        assert np.abs(torques(path, q, v, a) - expected).max() < 1e-6 * np.abs(expected).max()
        model = mujoco.MjModel.from_xml_path(str(path))
        principal = np.sort(model.body_inertia[model.body_mass > 0.0])
        assert (principal > 0.0).all()
        assert (principal[:, 0] + principal[:, 1] > principal[:, 2]).all()


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> MotionDiagnosis:
    folder = tmp_path_factory.mktemp("arm")
    return diagnosed(arm(folder), arm(folder, **TRUTH))


def test_the_mjcf_gives_the_torques_of_the_fit(found: MotionDiagnosis, tmp_path: Path) -> None:
    """The user's own file."""
    path, made = tmp_path / "out.xml", Written.of(found)
    held = made.held
    assert held.after < 0.2 * held.before
    made.is_what_mujoco_reads(path, 50)
    assert held.losses[1, 0] == pytest.approx(4.0, rel=0.05)
    assert held.losses[1, 2] == pytest.approx(0.6, rel=0.1)
    assert held.losses[0, 1] == pytest.approx(2.0, rel=0.05)
    again = Robot.from_mjcf(path, "base", "tip")
    assert again.losses is not None
    assert np.allclose(again.losses, held.losses, rtol=1e-12)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Written:
    """An UR10e, whose free estimate is no set of bodies."""
    folder = tmp_path_factory.mktemp("ur10e")
    cell = real_cell(folder, data / "ur10e_motion", "base_link", "tool0", 8.0)
    motions = load_motions(cell, cell.robot.source.files[0].with_name("motion.csv"))
    kinds = ("coulomb_friction", "viscous_friction", "armature", "pre_sliding", "inertials")
    cell = replace(cell, motion=replace(cell.motion, effects=kinds))
    result = calib.identify(cell, motions)
    assert isinstance(result, MotionDiagnosis)
    return Written.of(result)


def test_a_real_arm_is_written_as_bodies_that_give_its_torques(
    real: Written, tmp_path: Path
) -> None:
    result, held, links = real
    nominal, sizes = result.cell.robot, sizes_of(result.state.products)
    free = nominal_inertials(nominal) + (sizes * result.fit.x).reshape(-1, 10)
    assert np.linalg.eigvalsh(pseudo_inertias(free)).min() < 0.0
    assert held.after < 0.15 < held.before
    assert (np.linalg.eigvalsh(pseudo_inertias(links)) > 0.0).all()
    assert (held.losses >= 0.0).all()
    assert held.lacking == ("pre_sliding",)
    real.is_what_mujoco_reads(tmp_path / "out.xml", 51)
    lacks = real.file("urdf", tmp_path / "out.urdf")
    assert any("armature" in line for line in lacks)
    robot = Robot.from_urdf(tmp_path / "out.urdf", "base_link", "tool0")
    assert np.allclose(nominal_inertials(robot), links, rtol=1e-9, atol=1e-12)
    assert np.allclose(robot.origins, nominal.origins)
    assert robot.losses is not None
    assert np.allclose(robot.losses[:, :2], held.losses[:, :2])


def test_pinocchio_reads_the_same_torques_from_the_urdf(real: Written, tmp_path: Path) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    real.file("urdf", tmp_path / "out.urdf")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "out.urdf"))
    model.armature = real.held.losses[:, 2]
    model.gravity.linear = real.result.cell.gravity
    data, got = model.createData(), []
    _, *motion = fourier(np.random.default_rng(52), 6)
    for q, v, a in zip(*motion, strict=True):
        got.append(pinocchio.rnea(model, data, q, v, a) + real.held.losses[:, 0] * v)
    expected = real.torques(*motion)
    assert np.abs(np.array(got) - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("below_zero", [10, 17], ids=["mass of the second link", "its Iyy"])
def test_the_nearest_bodies_leave_what_is_one(below_zero: int) -> None:
    """A link that is a body stays; one that is none comes to the cone's edge, as near as any."""
    rng, sizes = np.random.default_rng(2), np.tile([2.0, *[0.6] * 3, *[0.18] * 6], 2)
    links = np.array([[2.0, 0.1, 0.0, 0.2, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1]] * 2)
    root = rng.normal(size=(20, 20))
    H, free = root @ root.T + np.eye(20), np.arange(20)
    small = rng.normal(size=20) * 1e-3
    assert np.allclose(physical(links, sizes, small, H, free), small, atol=1e-12)
    large = np.where(free == below_zero, -2.0, 0.0)
    found = physical(links, sizes, large, H, free)
    edge = np.linalg.eigvalsh(pseudo_inertias(links + (sizes * found).reshape(2, 10)))
    assert 0.0 < edge.min() < 1e-4
    missed = (found - large) @ H @ (found - large)
    for _ in range(200):  # no other body is nearer
        other = found + rng.normal(size=20) * 0.02
        if np.linalg.eigvalsh(pseudo_inertias(links + (sizes * other).reshape(2, 10))).min() > 1e-6:
            assert (other - large) @ H @ (other - large) > missed - 1e-6
    held = physical(links, sizes, large, H, free[:10])
    assert not held[10:].any()


def test_joints_of_one_body_have_one_link(tmp_path: Path) -> None:
    """The first of two joints of a body moves nothing that can change; the second moves the body."""
    path = tmp_path / "two.xml"
    path.write_text(
        """<mujoco><worldbody><body name="base"><body name="a"><joint name="x" axis="1 0 0"/>
        <joint name="y" axis="0 1 0" pos="0 0 .1"/><inertial pos="0 0 .3" mass="2"
        diaginertia=".1 .1 .1"/><site name="tip"/></body></body></worldbody></mujoco>"""
    )
    links, frames = own_links(Robot.from_mjcf(path, "base", "tip"))
    assert np.isnan(links[0]).all()
    assert links[1, :4] == pytest.approx([2.0, 0.0, 0.0, 0.4])
    assert frames[1, :3, 3] == pytest.approx([0.0, 0.0, -0.1])


CELL = """schema = 1  # a comment
[robot]
mjcf = "{}"
base = "base"
tip = "tip"
[model]
effects = ["torque_offset:j3"]  # kept
"""


def test_the_cell_takes_the_terms_up(found: MotionDiagnosis, tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(CELL.format(found.cell.robot.source.files[0]))
    cell = calib.load_cell(path)
    text, added = cell_with_terms(replace(found, cell=cell), tmp_path / "next.toml")
    assert "# a comment" in text
    assert "# kept" in text
    assert {"armature:j2", "viscous_friction:j2", "coulomb_friction:j1"} <= {*added}
    (tmp_path / "next.toml").write_text(text)
    assert calib.load_cell(tmp_path / "next.toml").motion.effects == ("torque_offset:j3", *added)


@pytest.mark.parametrize("excluded", ["payload", "inertials"])
def test_what_the_cell_excludes_takes_no_part(tmp_path: Path, excluded: str) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(CELL.format(arm(tmp_path)) + f'[diagnosis]\nexclude = ["{excluded}"]\n')
    cell = calib.load_cell(path)
    truth = tmp_path / "truth.xml"
    truth.write_text(arm(tmp_path).read_text().replace('mass="1"', 'mass="2"'))
    kinds = {own.effect for own in diagnose_motions(cell, day(truth, cell.robot, 6, 4)).causes}
    assert excluded not in kinds
    assert kinds & {PAYLOAD, "inertials", "spring"}


def test_commands_write_the_robot_and_the_cell(found: MotionDiagnosis, tmp_path: Path) -> None:
    cell, truth = tmp_path / "cell.toml", arm(tmp_path, **TRUTH)
    cell.write_text(CELL.format(found.cell.robot.source.files[0]))
    table = written(tmp_path, day(truth, found.cell.robot, 6, 1))
    urdf, mjcf, better, none = (
        tmp_path / name for name in ("out.urdf", "out.xml", "next.toml", "no")
    )
    written_to = ("--urdf", urdf, "--mjcf", mjcf, "--cell-out", better)
    said = run("diagnose", cell, table, *written_to)
    assert said.exit_code == 0, said.output
    assert "with the file as it was" in said.output
    assert "made anew from the MJCF" in said.output
    assert Robot.from_urdf(urdf, "base", "tip").losses is not None
    said = run("identify", better, table, "--mjcf", mjcf)
    assert said.exit_code == 0, said.output
    # Of the true arm nothing is missing, and nothing is written.
    cell.write_text(CELL.format(truth) + "[gravity]\nm_s2 = [0.3, -0.2, -9.7]\n")
    assert "is not written" in run("diagnose", cell, table, "--mjcf", none).output
    assert not none.exists()


# -- bags ----------------------------------------------------------------------------------------


def bag(
    folder: Path, name: str, kind: str = "mcap", *, effort: bool = True, stamped: bool = True,
    topics: tuple[str, ...] = ("/joint_states",),
) -> Path:  # fmt: skip
    """A recording of two joints at 100 Hz, written by the library; and messages of a gripper."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store, path = get_typestore(Stores.ROS2_HUMBLE), folder / name
    State = store.types["sensor_msgs/msg/JointState"]
    Header = store.types["std_msgs/msg/Header"]
    Time = store.types["builtin_interfaces/msg/Time"]
    plugin = getattr(rosbag2.StoragePlugin, kind.upper())
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, State.__msgtype__, typestore=store)
            for i in range(60):
                stamp = Time(1_700_000_000 * stamped, 10_000_000 * i * stamped)
                joints, values = ["j1", "j2"], np.array([np.sin(0.3 * i), 0.5])
                if i == 7:
                    joints, values = ["finger"], values[:1]
                force = -2.0 * values if effort else np.array([])
                message = State(Header(stamp, ""), joints, values, values, force)
                data = store.serialize_cdr(message, State.__msgtype__)
                writer.write(connection, 1_700_000_000_000_000_000 + 10_000_000 * i, data)
    return path


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_bags_become_runs(tmp_path: Path, kind: str) -> None:
    bags = [bag(tmp_path, name, kind) for name in ("monday", "tuesday")]
    table = tmp_path / "motion.csv"
    said = run("import", *bags, "-o", table)
    assert said.exit_code == 0, said.output
    assert "1 messages about other joints" in said.output
    lines = table.read_text().splitlines()
    assert lines[0] == "session,time_s,j1_rad,j2_rad,j1_Nm,j2_Nm"
    assert len(lines) == 1 + 2 * 59
    name, time, *values = lines[3].split(",")
    assert (name, float(time)) == ("monday", 0.02)
    expected = [np.sin(0.6), 0.5, -2.0 * np.sin(0.6), -1.0]
    assert [float(value) for value in values] == pytest.approx(expected)


def test_a_bag_of_slides_and_currents_by_one_file(tmp_path: Path) -> None:
    file, table = next(bag(tmp_path, "one").glob("*.mcap")), tmp_path / "motion.csv"
    options = ("--slides", "j2", "--effort", "A", "--session", "first", "-o", table)
    said = run("import", file, *options)
    assert said.exit_code == 0, said.output
    head, first, *_ = table.read_text().splitlines()
    assert head == "session,time_s,j1_rad,j2_m,j1_A,j2_A"
    assert first.startswith("first,0.000000000,")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"effort": False}, "without a position and an effort"),
        ({"stamped": False}, "no stamps"),
        ({"topics": ("/a", "/b")}, "has joints under /a, /b; name one by --topic"),
        ({"topics": ()}, "has no sensor_msgs/msg/JointState"),
    ],
)
def test_faults_of_bags_are_one_line(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_bag(bag(tmp_path, "b", **change))


def test_what_is_no_bag_and_a_missing_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "b.mcap"
    file.write_bytes(b"nothing of the kind")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "rosbags.highlevel", None)
        with pytest.raises(InputError, match="needs rosbags, which is not installed"):
            read_bag(file)
    pytest.importorskip("rosbags")
    with pytest.raises(InputError, match="cannot be read as a bag"):
        read_bag(file)
