"""Robots with several tips against MuJoCo, which reads the same tree and shares no code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell, Tracker
from calib.arm.kinematics import forward, link_origins
from calib.arm.mimic import Coupling
from calib.arm.robot import Robot
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.errors import CalibError
from calib.files.mjcf import load_mjcf
from calib.model import Model
from calib.model.build import build
from calib.poses import Poses, poses_at
from tests.calib.arm.test_mujoco import in_mujoco
from tests.helpers import (
    GRAVITY,
    all_seen,
    central_difference,
    model_of,
    random_context,
    random_poses,
)
from tests.trees import as_mjcf, random_tree, read, tips_of, urdf

SEEDS = range(20)


class Tree:
    """A random robot, and MuJoCo's of the same file, a URDF or an MJCF."""

    def __init__(self, folder: Path, seed: int, form: str = "urdf") -> None:
        joints, chain = random_tree(seed)
        tip = f"c{len(chain)}"
        others = tips_of(joints, tip, seed)
        self.rng = np.random.default_rng(seed)
        self.model: Any = in_mujoco(urdf(joints))
        self.robot: Robot = read(folder, joints, tip, others)
        if form == "mjcf":
            (folder / "tree.xml").write_text(as_mjcf(urdf(joints)))
            self.robot = load_mjcf(folder / "tree.xml", "c0", tip, others)
            self.model = mujoco.MjModel.from_xml_path(str(folder / "tree.xml"))
        assert self.robot.tips == (*others, tip)
        self.model.opt.gravity = GRAVITY
        self.data: Any = mujoco.MjData(self.model)
        own = [self.model.joint(name) for name in self.robot.joints]
        self.qpos = [int(joint.qposadr[0]) for joint in own]
        self.dofs = [int(joint.dofadr[0]) for joint in own]
        self.poses = random_poses(self.rng, self.robot, 4)

    def stand(self, q: Array) -> tuple[Array, Array]:
        """Move there; rotation and place of the base."""
        self.data.qpos[:] = 0.0
        self.data.qpos[self.qpos] = q
        mujoco.mj_forward(self.model, self.data)
        base = self.data.body("c0")
        return base.xmat.reshape(3, 3).copy(), base.xpos.copy()

    def slopes(self, at: Array) -> tuple[Array, Array]:
        """How a point (3,) of the first tip, and that tip's axes, move with the joints, (3, n)."""
        place, turn = np.zeros((2, 3, self.model.nv))
        body = self.data.body(self.robot.tips[0])
        mujoco.mj_jac(self.model, self.data, place, turn, at, body.id)
        return place[:, self.dofs], turn[:, self.dofs]

    def carried(self, kinds: tuple[str, ...]) -> Model:
        """A marker on every tip, read in base axes, under effects at every place."""
        context = random_context(self.rng, self.robot, len(self.robot.tips))
        first = self.robot.dof + 1
        frames = np.arange(first, self.robot.frame_count)
        return replace(model_of(context, kinds), marker_frames=frames)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("seed", SEEDS)
def test_tips_and_torques_are_those_of_mujoco(tmp_path: Path, seed: int, form: str) -> None:
    tree = Tree(tmp_path, seed, form)
    robot, q = tree.robot, tree.poses.q
    frames = forward(robot, q)
    for i, row in enumerate(q):
        R, p = tree.stand(row)
        gravity = R.T @ GRAVITY
        loads = loads_of(robot, poses_at(q), Payload(), gravity)
        local = transmitted(robot, loads, frames, link_origins(robot, frames, q)).local
        along = local[i, 1 : robot.dof + 1]
        felt = np.where(robot.prismatic[:, None], along[:, :3], along[:, 3:])
        ours = (felt * robot.axes).sum(axis=-1)
        # What MuJoCo holds against is what the drives must.
        np.testing.assert_allclose(ours, -tree.data.qfrc_bias[tree.dofs], atol=1e-9)
        for number, tip in enumerate(robot.tips, robot.dof + 1):
            there = tree.data.body(tip)
            np.testing.assert_allclose(R @ frames.o[i, number] + p, there.xpos, atol=1e-12)
            turn = R @ frames.R[i, number]
            np.testing.assert_allclose(turn, there.xmat.reshape(3, 3), atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_derivatives_of_every_effect_on_a_tree(tmp_path: Path, seed: int) -> None:
    """Against differences of the prediction, the arm bent by its weight, a load and a wrench."""
    tree = Tree(tmp_path, seed)
    context = random_context(tree.rng, tree.robot, len(tree.robot.tips))
    if seed % 2:  # carried by another tip
        other = tree.robot.dof + 1
        context = replace(
            context,
            payload=replace(context.payload, frame=other),
            robot=replace(tree.robot, loaded=other),
        )
    if seed % 4 > 1:  # drives that move several joints
        context = replace(context, robot=replace(coupled(tree)[0], loaded=context.robot.loaded))
    poses = replace(tree.poses, q=context.robot.tied(tree.poses.q))
    arm = ("base", "tool", "geometry", "joint_compliance", "link_weight", "payload")
    kinds = (*arm, "bearing_compliance", "gravity_sag", "thermal_expansion", "joint_coupling")
    tips = np.arange(tree.robot.dof + 1, tree.robot.frame_count)
    model = replace(model_of(context, kinds), marker_frames=tips)
    values = tree.rng.normal(size=len(model.parameters)) * model.sizes * 0.3
    values = np.where(
        np.isin(np.arange(len(values)), model.where(*_soft())), np.abs(values), values
    )
    _, J = model.jacobian(values, poses)
    numeric = central_difference(lambda v: model.predict(v, poses), values, model.sizes * 1e-2)
    error = np.abs(J - numeric) * model.sizes
    assert error.max() < 1e-9


def coupled(tree: Tree) -> tuple[Robot, Array]:
    """The robot with a joint that two others move, and one that this moves; how all move, (n, n)."""
    robot, factors = tree.robot, tree.rng.uniform(-1.5, 1.5, 3).tolist()
    c, *others = tree.rng.permutation(robot.dof).tolist()
    names, moved = robot.joints, np.eye(robot.dof)
    a, b = others[0], others[min(1, len(others) - 1)]
    by = {names[a]: factors[0], names[b]: factors[1]}
    found = [Coupling(names[c], tuple(by.items()), 0.1)]
    moved[c, [a, b]] = by[names[a]], by[names[b]]
    for d in others[2:3]:
        found.append(Coupling(names[d], ((names[c], factors[2]),), -0.05))
        moved[d, [a, b, c]] = factors[2] * moved[c, [a, b, c]]
    return replace(robot, couplings=tuple(found)), moved


def compliant(tree: Tree, robot: Robot) -> Model:
    """A marker on every tip of a robot whose drives yield under its weight."""
    context = random_context(tree.rng, robot, len(robot.tips))
    gravity = tree.stand(tree.poses.q[0])[0].T @ GRAVITY
    context = replace(context, payload=Payload(), gravity=gravity)
    frames = np.arange(robot.dof + 1, robot.frame_count)
    return replace(model_of(context, ("joint_compliance",)), marker_frames=frames)


@pytest.mark.parametrize("seed", SEEDS)
def test_drives_yield_under_all_that_they_move_as_in_mujoco(tmp_path: Path, seed: int) -> None:
    """By virtual work: the drive of a parallelogram holds its own joint and those that follow."""
    tree = Tree(tmp_path, seed)
    robot, moved = coupled(tree)
    model, q = compliant(tree, robot), robot.tied(tree.poses.q)
    poses = poses_at(q)
    c = np.where(robot.prismatic, 1e-5, 2e-5) * tree.rng.uniform(0.5, 2.0, robot.dof)
    tree.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    points = model.tip_points(model.state(c, poses).frames, c, poses)
    for i, row in enumerate(q):
        bent = row
        for _ in range(30):
            R, p = tree.stand(bent)
            felt = moved.T @ -tree.data.qfrc_bias[tree.dofs]
            bent = row + moved @ (c * felt)
        for j, tip in enumerate(robot.tips):
            there = tree.data.body(tip)
            expected = there.xpos + there.xmat.reshape(3, 3) @ model.markers[j]
            np.testing.assert_allclose(R @ points[i, j] + p, expected, atol=1e-8)
        # The energy of the links says the same of the torques.
        for k in range(robot.dof):
            energy = []
            for h in (1e-4, -1e-4):
                tree.stand(bent + h * moved[:, k])
                energy.append(tree.data.energy[0])
            work = (energy[1] - energy[0]) / 2e-4
            assert abs(work - felt[k]) < 1e-5 * max(1.0, abs(felt[k]))


def _soft() -> list[type]:
    return [EFFECTS["joint_compliance"], EFFECTS["bearing_compliance"]]


@pytest.mark.parametrize("seed", range(3))
def test_two_hands_on_a_torso_are_identified_together(seed: int) -> None:
    """Simulated without noise: what was put in comes out, of one fit, from places nobody gave."""
    cell, poses, truth = two_hands(seed)
    model = build(cell, poses).model
    values = truth * model.sizes
    readings = model.predict(values, poses)
    found = calib.identify(cell, all_seen(poses, readings))
    np.testing.assert_allclose(found.values / model.sizes, truth, atol=1e-6)
    assert {p.where for p in model.parameters} >= {"torso", "right3", "left3"}


def two_hands(seed: int) -> tuple[Cell, Poses, Array]:
    """Arms of four joints on a torso of two, a marker on each; poses, and errors in their sizes."""
    rng = np.random.default_rng(seed)
    sides = [f"{side}{k}" for side in ("right", "left") for k in range(1, 5)]
    joints = ("hip", "torso", *sides)
    origins = np.tile(np.eye(4), (len(joints) + 2, 1, 1))
    origins[:, :3, :3] = np.linalg.qr(rng.normal(size=(len(origins), 3, 3)))[0]
    origins[np.linalg.det(origins[:, :3, :3]) < 0, :3, 0] *= -1.0
    origins[:, :3, 3] = rng.uniform(-0.4, 0.4, (len(origins), 3))
    robot = replace(
        Robot.of_geometry("pair", ("base", "right_hand"), joints, np.zeros(10, bool), origins[:11]),
        origins=origins,
        others=("left_hand",),
        parents=(0, 1, 2, 3, 4, 5, 2, 7, 8, 9, 10, 6),
        masses=rng.uniform(1.0, 5.0, 10),
        coms=rng.uniform(-0.1, 0.1, (10, 3)),
    )
    markers = {"right_m": (0.1, 0.02, 0.05), "left_m": (0.08, -0.03, 0.04)}
    cell = Cell(
        robot,
        markers,
        Tracker(sigma=1e-9),
        ("base", "tool", "geometry", "joint_compliance"),
        marker_links=("right_hand", "left_hand"),
    )
    poses = poses_at(rng.uniform(-2.0, 2.0, (60, 10)))
    count = len(build(cell, poses).model.parameters)
    return cell, poses, np.abs(rng.normal(size=count))


def test_a_marker_on_no_tip_is_refused() -> None:
    cell, _, _ = two_hands(0)
    with pytest.raises(
        CalibError, match="'foot' is no tip of the robot; tips are left_hand, right_hand"
    ):
        _ = replace(cell, marker_links=("right_hand", "foot")).marker_frames


def test_a_soft_joint_of_one_arm_is_found_among_those_of_both() -> None:
    """Nothing but the elbow of the left arm yields, and the diagnosis says so."""
    cell, _, _ = two_hands(0)
    rng = np.random.default_rng(0)
    poses = poses_at(rng.uniform(-2.0, 2.0, (40, 10)))
    own = replace(cell, instruments=(Tracker(sigma=2e-5),), effects=("base", "tool", "geometry"))
    soft = own.with_effects("joint_compliance:left3")
    model = build(soft, poses).model
    sizes = {"geometry": 3e-4, "joint_compliance": 8e-5}
    values = np.array([sizes.get(p.effect, 0.0) for p in model.parameters])
    data = calib.simulate(soft, poses, values, rng=1)
    found = calib.diagnose(own, data)
    (cause,) = found.causes
    assert cause.evidence.key == "joint_compliance:left3"


@pytest.mark.parametrize("seed", range(8))
def test_loads_weigh_on_the_joints_that_carry_their_link(tmp_path: Path, seed: int) -> None:
    """Payload, hung load and wrench against their powers by MuJoCo's derivatives of the link."""
    tree = Tree(tmp_path, seed)
    frame = tree.robot.dof + 1
    robot = replace(tree.robot, loaded=frame)
    carried, wrench = Payload(3.0, (0.1, -0.05, 0.2), frame), tree.rng.normal(size=6)
    for row in tree.poses.q:
        R, p = tree.stand(row)
        free, frames = poses_at(row[None]), forward(robot, row[None])
        hung = replace(free, load_mass=np.array([3.0]), load_com=np.array(carried.com))
        pulled = replace(free, wrench=wrench[None])
        felt = []
        loads = ((free, Payload()), (free, carried), (hung, Payload()), (pulled, Payload()))
        for poses, payload in loads:
            own = loads_of(robot, poses, payload, R.T @ GRAVITY)
            origins = link_origins(robot, frames, row[None])
            along = transmitted(robot, own, frames, origins).local[0, 1 : robot.dof + 1]
            pushed = np.where(robot.prismatic[:, None], along[:, :3], along[:, 3:])
            felt.append((pushed * robot.axes).sum(axis=-1))
        ends = frames.R[0, frame] @ carried.com + frames.o[0, frame], frames.o[0, frame]
        (slopes, _), (at_tip, turns) = (tree.slopes(R @ end + p) for end in ends)
        weighs = slopes.T @ (carried.mass * GRAVITY)
        pulls = at_tip.T @ (R @ wrench[:3]) + turns.T @ (R @ wrench[3:])
        for change, expected in zip(felt[1:], (weighs, weighs, pulls), strict=True):
            np.testing.assert_allclose(change - felt[0], expected, atol=1e-9)
