"""Robots with several tips, and what rides on their links, against MuJoCo, which shares no code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell, Poses, Tracker
from calib.arm.kinematics import Frames, forward, link_origins
from calib.arm.robot import Robot
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arm.ties import Coupling
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.effects.tool_base import Base
from calib.errors import CalibError, InputError
from calib.files.cell import load_cell
from calib.files.mjcf import load_mjcf
from calib.files.robot_out import corrected_robot, corrected_urdf
from calib.files.urdf import load_urdf
from calib.instruments.riding import corners_of
from calib.model import Model
from calib.model.build import build
from calib.poses import poses_at
from tests.helpers import (
    GRAVITY,
    all_seen,
    central_difference,
    model_of,
    random_context,
    random_poses,
    simulated,
    with_effects,
)
from tests.trees import as_mjcf, in_mujoco, placed, random_tree, read, urdf

SEEDS = [*range(5), *(pytest.param(k, marks=pytest.mark.long) for k in range(5, 12))]


def felt(robot: Robot, poses: Poses, frames: Frames, payload: Payload, gravity: Array) -> Array:
    """What the drives hold against, (m, n), N m or N."""
    origins = link_origins(robot, frames, poses.q)
    along = transmitted(robot, loads_of(robot, poses, payload, gravity), frames, origins).local
    along = along[:, 1 : robot.dof + 1]
    return (np.where(robot.prismatic[:, None], along[..., :3], along[..., 3:]) * robot.axes).sum(-1)


class Tree:
    """A random robot, and MuJoCo's of the same file, a URDF or an MJCF."""

    def __init__(self, folder: Path, seed: int, form: str = "urdf") -> None:
        joints, tip, others = random_tree(seed)
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
        self.tips = np.arange(self.robot.dof + 1, self.robot.frame_count)
        self.poses = random_poses(self.rng, self.robot, 4)

    def stand(self, q: Array) -> tuple[Array, Array]:
        """Move there; rotation and place of the base."""
        self.data.qpos[:] = 0.0
        self.data.qpos[self.qpos] = q
        mujoco.mj_forward(self.model, self.data)
        return self.at("c0")

    def at(self, link: str) -> tuple[Array, Array]:
        body = self.data.body(link)
        return body.xmat.reshape(3, 3).copy(), body.xpos.copy()

    def slopes(self, at: Array) -> tuple[Array, Array]:
        """How a point (3,) of the first tip, and that tip's axes, move with the joints, (3, n)."""
        place, turn = np.zeros((2, 3, self.model.nv))
        body = self.data.body(self.robot.tips[0])
        mujoco.mj_jac(self.model, self.data, place, turn, at, body.id)
        return place[:, self.dofs], turn[:, self.dofs]

    def carried(self, kinds: Sequence[str], robot: Robot | None = None, **given: object) -> Model:
        """A marker on every tip, read in base axes, under effects at every place."""
        context = random_context(self.rng, robot or self.robot, len(self.tips))
        return replace(model_of(replace(context, **given), kinds), marker_frames=self.tips)

    def coupled(self) -> tuple[Robot, Array]:
        """With a joint that two others move, and one that this moves; how all move, (n, n)."""
        robot, factors = self.robot, self.rng.uniform(-1.5, 1.5, 3).tolist()
        c, *others = self.rng.permutation(robot.dof).tolist()
        names, moved = robot.joints, np.eye(robot.dof)
        a, b = others[0], others[min(1, len(others) - 1)]
        by = {names[a]: factors[0], names[b]: factors[1]}
        found = [Coupling(names[c], tuple(by.items()), 0.1)]
        moved[c, [a, b]] = by[names[a]], by[names[b]]
        for d in others[2:3]:
            found.append(Coupling(names[d], ((names[c], factors[2]),), -0.05))
            moved[d, [a, b, c]] = factors[2] * moved[c, [a, b, c]]
        return replace(robot, couplings=tuple(found)), moved


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("seed", SEEDS)
def test_tips_and_torques_are_those_of_mujoco(tmp_path: Path, seed: int, form: str) -> None:
    tree = Tree(tmp_path, seed, form)
    frames = forward(tree.robot, tree.poses.q)
    for i, row in enumerate(tree.poses.q):
        R, p = tree.stand(row)
        here = forward(tree.robot, row[None])
        ours = felt(tree.robot, poses_at(row[None]), here, Payload(), R.T @ GRAVITY)[0]
        # What MuJoCo holds against is what the drives must.
        np.testing.assert_allclose(ours, -tree.data.qfrc_bias[tree.dofs], atol=1e-9)
        for number, tip in zip(tree.tips, tree.robot.tips, strict=True):
            turn, place = tree.at(tip)
            np.testing.assert_allclose(R @ frames.o[i, number] + p, place, atol=1e-12)
            np.testing.assert_allclose(R @ frames.R[i, number], turn, atol=1e-12)


def seated(model: Model, under: int) -> Model:
    """The model with a tracker in the axes of one of its tips' links, as well."""
    count = len(model.markers)
    own = Tracker(name="rider", markers=tuple(range(count)), seat=slice(count, count + 3))
    return replace(
        model,
        markers=np.concatenate([model.markers, corners_of(np.eye(3), np.zeros(3))]),
        marker_names=(*model.marker_names, "o", "x", "y"),
        marker_frames=np.concatenate([model.marker_frames, 3 * [under]]),
        instruments=(own,),
    )


@pytest.mark.parametrize(
    ("seed", "rides"), [*((k, False) for k in range(8)), *((k, True) for k in range(4))]
)
def test_derivatives_of_every_effect_on_a_tree(tmp_path: Path, seed: int, rides: bool) -> None:
    """Against differences of the prediction, the arm bent by its weight, a load and a wrench."""
    tree = Tree(tmp_path, seed)
    robot, payload = tree.robot, Payload(1.5, (0.0, 0.02, 0.05))
    if seed % 2:  # carried by another tip
        payload = replace(payload, frame=robot.dof + 1)
        robot = replace(robot, loaded=robot.dof + 1)
    if seed % 4 > 1:  # drives that move several joints
        robot = replace(tree.coupled()[0], loaded=robot.loaded)
    poses = replace(tree.poses, q=robot.tied(tree.poses.q))
    arm = ("base", "tool", "geometry", "joint_compliance", "link_weight", "payload", "base_drift")
    kinds = (*arm, "bearing_compliance", "gravity_sag", "thermal_expansion", "joint_coupling")
    model = tree.carried(kinds, robot, payload=payload)
    model = seated(model, robot.dof + 1) if rides else model
    values = tree.rng.normal(size=len(model.parameters)) * model.sizes * 0.3
    soft = model.where(EFFECTS["joint_compliance"], EFFECTS["bearing_compliance"])
    values[soft] = np.abs(values[soft])
    _, J = model.jacobian(values, poses)
    numeric = central_difference(lambda v: model.predict(v, poses), values, model.sizes * 1e-2)
    assert np.abs((J - numeric) * model.sizes).max() < 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_drives_yield_under_all_that_they_move_as_in_mujoco(tmp_path: Path, seed: int) -> None:
    """By virtual work: the drive of a parallelogram holds its own joint and those that follow."""
    tree = Tree(tmp_path, seed)
    robot, moved = tree.coupled()
    q = robot.tied(tree.poses.q)
    gravity = tree.stand(tree.poses.q[0])[0].T @ GRAVITY
    model = tree.carried(("joint_compliance",), robot, payload=Payload(), gravity=gravity)
    c = np.where(robot.prismatic, 1e-5, 2e-5) * tree.rng.uniform(0.5, 2.0, robot.dof)
    points = model.tip_points(model.state(c, poses_at(q)).frames, c, poses_at(q))
    for i, row in enumerate(q):
        bent = row
        for _ in range(30):
            R, p = tree.stand(bent)
            held = moved.T @ -tree.data.qfrc_bias[tree.dofs]
            bent = row + moved @ (c * held)
        for j, tip in enumerate(robot.tips):
            turn, place = tree.at(tip)
            expected = place + turn @ model.markers[j]
            np.testing.assert_allclose(R @ points[i, j] + p, expected, atol=1e-8)


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
        loads = ((free, Payload()), (free, carried), (hung, Payload()), (pulled, Payload()))
        none, *changed = (felt(robot, *own, R.T @ GRAVITY)[0] for own in (
            (poses, frames, payload) for poses, payload in loads))  # fmt: skip
        ends = frames.R[0, frame] @ carried.com + frames.o[0, frame], frames.o[0, frame]
        (slopes, _), (at_tip, turns) = (tree.slopes(R @ end + p) for end in ends)
        weighs = slopes.T @ (carried.mass * GRAVITY)
        pulls = at_tip.T @ (R @ wrench[:3]) + turns.T @ (R @ wrench[3:])
        for own, expected in zip(changed, (weighs, weighs, pulls), strict=True):
            np.testing.assert_allclose(own - none, expected, atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_link_sees_of_another_is_what_mujoco_has_between_them(
    tmp_path: Path, seed: int
) -> None:
    tree = Tree(tmp_path, seed)
    robot, under = tree.robot, tree.robot.dof + 1
    model = seated(tree.carried(("joint_offset",)), under)
    readings = model.predict(model.initial, tree.poses)
    for i, row in enumerate(tree.poses.q):
        tree.stand(row)
        R, p = tree.at(robot.tips[0])
        for j, tip in enumerate(robot.tips):
            turn, place = tree.at(tip)
            expected = R.T @ (turn @ model.markers[j] + place - p)
            np.testing.assert_allclose(readings[i, j], expected, atol=1e-12)


# -- Two hands on a torso


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
    effects = ("base", "tool", "geometry", "joint_compliance")
    links = ("right_hand", "left_hand")
    cell = Cell(robot, markers, Tracker(sigma=1e-9), effects, marker_links=links)
    poses = poses_at(rng.uniform(-2.0, 2.0, (60, 10)))
    count = len(build(cell, poses).model.parameters)
    return cell, poses, np.abs(rng.normal(size=count))


@pytest.mark.long
def test_a_soft_joint_of_one_arm_is_found_among_those_of_both() -> None:
    """Nothing but the elbow of the left arm yields, and the diagnosis says so."""
    cell, _, _ = two_hands(0)
    poses = poses_at(np.random.default_rng(0).uniform(-2.0, 2.0, (40, 10)))
    own = replace(cell, instruments=(Tracker(sigma=2e-5),), effects=("base", "tool", "geometry"))
    soft = own.with_effects("joint_compliance:left3")
    sizes = {"geometry": 3e-4, "joint_compliance": 8e-5}
    values = [sizes.get(p.effect, 0.0) for p in build(soft, poses).model.parameters]
    (cause,) = calib.diagnose(own, calib.simulate(soft, poses, np.array(values), rng=1)).causes
    assert cause.evidence.key == "joint_compliance:left3"


@pytest.mark.parametrize("tip", ["right_hand", pytest.param("left_hand", marks=pytest.mark.long)])
def test_two_hands_are_identified_together_and_brought_into_place(tip: str) -> None:
    """Without noise what was put in comes out of one fit; commands bring the named hand."""
    cell, poses, truth = two_hands(1)
    cell = replace(cell, robot=replace(cell.robot, limits=np.tile([-3.0, 3.0], (10, 1))))
    robot, model = cell.robot, build(cell, poses).model
    values = 0.3 * truth * model.sizes
    found = calib.identify(cell, all_seen(poses, model.predict(values, poses)))
    np.testing.assert_allclose((found.values - values) / model.sizes, 0.0, atol=1e-6)
    targets = poses_at(np.random.default_rng(2).uniform(-1.5, 1.5, (20, robot.dof)))
    corrected = calib.compensate(cell, found, targets, tip=tip)
    frame = robot.dof + 1 + robot.tips.index(tip)
    frames = model.state(values, replace(targets, q=corrected.q)).frames
    wanted, met = forward(robot, targets.q), corrected.left < 1e-9
    assert met.sum() > 15
    np.testing.assert_allclose(frames.o[met, frame], wanted.o[met, frame], atol=1e-8)
    np.testing.assert_allclose(frames.R[met, frame], wanted.R[met, frame], atol=1e-8)
    beside = [j for j, moves in enumerate(robot.moving(frame)) if not moves]
    np.testing.assert_allclose(corrected.q[:, beside], targets.q[:, beside], atol=1e-14)
    assert any(note.startswith(f"commands are corrected for {tip}") for note in corrected.notes)
    if tip == robot.tip:  # of several tips that of the robot is meant
        own = calib.compensate(cell, found, targets)
        np.testing.assert_array_equal(own.q, corrected.q)
    with pytest.raises(CalibError, match="nothing is read on foot"):
        calib.compensate(cell, found, targets, tip="foot")
    said = "'foot' is no tip of the robot; tips are left_hand, right_hand"
    with pytest.raises(CalibError, match=said):
        _ = replace(cell, marker_links=("right_hand", "foot")).marker_frames


# -- Corrected robots lead to the same markers in MuJoCo


def body_positions(text: str, names: Sequence[str], q: Array, qpos: object = slice(None)) -> Array:
    """Origins of bodies of a URDF in its root's axes, shape (m, len(names), 3)."""
    model: Any = in_mujoco(text)
    data: Any = mujoco.MjData(model)
    out = []
    for row in q:
        data.qpos[qpos] = row
        mujoco.mj_kinematics(model, data)
        out.append([data.body(name).xpos.copy() for name in names])
    return np.array(out)


@pytest.mark.parametrize("effects", [("base", "tool", "geometry"), ("base", "geometry")])
def test_a_corrected_urdf_leads_to_the_same_markers(
    kr270: Cell, table_two: Poses, tmp_path: Path, effects: tuple[str, ...]
) -> None:
    """With known markers its last fixed joint is corrected; the file reads back as a robot."""
    cell, path = with_effects(kr270, *effects), tmp_path / "out.urdf"
    data, _, _ = simulated(cell, table_two, 3)
    result = calib.identify(cell, data)
    markers = dict(zip(cell.marker_names, result.marker_positions, strict=True))
    corrections = result.model.constant_displacements(result.values)
    text = corrected_urdf(cell.robot_files[0], cell.robot, corrections, markers)
    in_base = body_positions(text, [f"marker_{name}" for name in markers], data.poses.q)
    ((_, part),) = result.model.of(Base)
    R, p = Tracker.placement(result.values[part])
    predicted = result.model.predict(result.values, data.poses)
    np.testing.assert_allclose(in_base @ R.T + p, predicted, atol=1e-9)
    path.write_text(text)
    again = forward(load_urdf(path, "base_link", "tool0"), data.poses.q)
    displaced = forward(kr270.robot, data.poses.q, corrections)
    np.testing.assert_allclose(again.o[:, -1], displaced.o[:, -1], atol=1e-12)


# -- Cells of trees: read, refused, written


def tree_cell(
    folder: Path, on: str, robot: str = 'urdf = "tree.urdf"', more: str = "", seed: int = 3
) -> Path:
    joints, tip, _ = random_tree(seed)
    (folder / "tree.urdf").write_text(urdf(joints))
    (folder / "tree.xml").write_text(as_mjcf(urdf(joints)))
    (folder / "cell.toml").write_text(
        f'schema = 1\n[robot]\n{robot}\nbase = "c0"\ntip = "{tip}"\n[markers_mm]\n'
        f'right = [100, 20, 50]\nleft = {{ position = [80, -30, 40], on = "{on}" }}\n'
        f'[instrument]\nsigma_mm = 0.01\n{more}[model]\neffects = ["base", "tool", "geometry"]\n'
    )
    return folder / "cell.toml"


def ends(seed: int = 3) -> tuple[str, str]:
    """The robot's tip, and another."""
    _, tip, others = random_tree(seed)
    return tip, others[0]


def test_markers_and_loads_ride_on_the_links_that_the_cell_names(tmp_path: Path) -> None:
    tip, other = ends()
    loads = f'[payload]\nmass_kg = 2.0\ncom_mm = [0, 0, 100]\non = "{other}"\n'
    loads += loads.replace("payload", "load").replace("2.0", "5.0")
    cell = load_cell(tree_cell(tmp_path, other, more=loads))
    assert cell.robot.tips == (other, tip)
    assert cell.marker_links == (tip, other)
    assert cell.payload.frame == cell.robot.loaded == cell.robot.dof + 1
    frames = forward(cell.robot, np.zeros((1, cell.robot.dof)))
    for link, frame in zip(cell.marker_links, cell.marker_frames, strict=True):
        alone = read(tmp_path, random_tree(3)[0], link)
        there = forward(alone, np.zeros((1, alone.dof)))
        np.testing.assert_allclose(frames.o[0, frame], there.o[0, -1], atol=1e-12)
    own = tree_cell(tmp_path, tip, more=loads.replace(other, tip))
    assert load_cell(own).payload.frame == -1


APART = '[[known_distances]]\nbetween = ["right", "left"]\nmm = 50.0\nsigma_mm = 0.1\n'
DH = 'dh = "tree.csv"\ndh_convention = "classic"'


@pytest.mark.parametrize(
    ("on", "named", "said"),
    [
        ("c99", {}, "tree.urdf: has no link 'c99'; set 'on' of what it carries to one of: root, c0"),
        ("root", {}, "link root: no chain of joints leads from 'c0' to it"),
        ("b0", {"robot": DH}, "tree.csv: has one tip, and 'b0' is another; write the robot as a URDF"),
        ("c1", {"more": APART},
         "'right' and 'left' ride on c6 and c1, and are no known length apart; take it out"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_one_line(
    tmp_path: Path, on: str, named: dict[str, str], said: str
) -> None:
    with pytest.raises(InputError) as error:
        load_cell(tree_cell(tmp_path, on, **named))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(8))
def test_a_corrected_tree_leads_to_the_same_markers_in_mujoco(tmp_path: Path, seed: int) -> None:
    cell = load_cell(tree_cell(tmp_path, ends(seed)[1], seed=seed))
    rng, robot = np.random.default_rng(seed), cell.robot
    corrections = rng.normal(size=(robot.frame_count, 6)) * 1e-2
    corrections[0] = 0.0
    markers = dict(zip(cell.marker_names, cell.markers, strict=True))
    text = corrected_robot(cell, corrections, markers, tmp_path / "out.urdf").text
    model: Any = in_mujoco(text)
    q = rng.uniform(-1.0, 1.0, (4, robot.dof))
    frames = forward(robot, q, corrections)
    qpos = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    names = ["c0", *(f"marker_{name}" for name in markers)]
    found = body_positions(text, names, q, qpos)
    root = mujoco.MjData(model)
    mujoco.mj_kinematics(model, root)
    R = root.body("c0").xmat.reshape(3, 3)
    for j, (frame, marker) in enumerate(zip(cell.marker_frames, cell.markers, strict=True), 1):
        ours = frames.o[:, frame] + frames.R[:, frame] @ marker
        np.testing.assert_allclose(ours @ R.T + found[:, 0], found[:, j], atol=1e-9)


def test_a_tree_of_another_form_is_refused(tmp_path: Path) -> None:
    cell = load_cell(tree_cell(tmp_path, ends()[1], 'mjcf = "tree.xml"'))
    with pytest.raises(InputError, match=r"one tip, and this robot has .*; name the robot's URDF"):
        corrected_robot(cell, np.zeros((cell.robot.frame_count, 6)), {}, tmp_path / "out.urdf")


@pytest.mark.parametrize("seed", range(4))
def test_shapes_beside_the_chain_go_with_the_link_that_carries_them(
    tmp_path: Path, seed: int
) -> None:
    """All beside the chain, and beyond its tip, is held at zero."""
    joints, tip, _ = random_tree(seed)
    robot = read(tmp_path, joints, tip)
    T, owner = placed(joints, {}), {"c0": "base"}
    for joint in joints:
        if joint.parent in owner:
            moves = joint.name in robot.joints
            owner[joint.child] = joint.name if moves else owner[joint.parent]
    carrier = {"base": "c0"} | {j.name: j.child for j in joints}
    for name, capsules in robot.shapes.capsules.items():
        links = [j for j in joints if owner.get(j.child) == name]
        frame = np.linalg.inv(T[carrier[name]])
        expected = sorted(tuple((frame @ T[j.child] @ [*j.com, 1.0])[:3]) for j in links)
        np.testing.assert_allclose(sorted(c.start for c in capsules), expected, atol=1e-9)
