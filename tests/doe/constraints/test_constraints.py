"""The constraints of a cell: which there are, what each allows, and what its instrument sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import doe
from calib import Cell, Tracker, load_cell
from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Capsule, Shapes
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arm.ties import Coupling
from calib.cell import Load
from doe.constraints import constraints_of, scene_of, visible
from doe.constraints.limits import static_torques
from doe.constraints.scene import Scene
from tests.calib.test_trees import two_hands
from tests.doe.constraints.arms import (
    CAPSULE,
    LINK,
    capsule_geoms,
    configurations,
    planar,
    shaped,
)
from tests.helpers import GRAVITY, designed, read_by
from tests.studies.command_line import paper_cell


def test_constraints_of_a_cell_file(tmp_path: Path) -> None:
    """What a cell file says in millimetres and degrees, at three configurations of the KR 270."""
    path = paper_cell(tmp_path)
    tables = """
        [robot.capsules_mm]
        A3 = [{ from = [0, 0, 0], to = [1100, 0, 0], radius = 80 }]
        [[design.obstacle]]
        type = "box"
        center_mm = [2700, 0, 750]
        size_mm = [400, 400, 400]
        [[design.obstacle]]
        type = "halfspace"
        point_mm = [0, 0, 500]
        normal = [0, 0, -1]
        [[design.obstacle]]
        type = "sphere"
        center_mm = [0, 2000, 750]
        radius_mm = 300
        """
    text = path.read_text().replace(
        "com_mm = [300, 0, 150]", "com_mm = [300, 0, 150]\nmax_tilt_deg = 20"
    )
    text = text.replace("[instrument]", "[instrument]\nposition_mm = [-5000, 0, 750]")
    path.write_text(text + tables)
    cell = load_cell(path)
    # Stretched forward; to the right, A1 turns about -z; forward and raised; bent to the floor.
    q = np.radians(
        [
            [0.0, -0.01, 0, 0, 0, 0],
            [-90.0, -0.01, 0, 0, 0, 0],
            [0.0, -45.0, 0, 0, 0, 0],
            [45.0, -0.01, 30, 0, -30, 0],
        ]
    )
    scene = scene_of(cell, q)
    assert {c.name: c.allows(scene).tolist() for c in constraints_of(cell)} == {
        "joint_limits": [True, True, True, True],
        "obstacle 1 (box)": [False, True, True, True],
        "obstacle 2 (halfspace)": [True, True, True, False],
        "obstacle 3 (sphere)": [True, False, True, True],
        "hanging_load": [True, True, False, True],
    }
    # From behind, stretched forward, the box and the arm stand before all three markers.
    assert visible(scene).tolist() == [[False] * 3, [True] * 3, [True] * 3, [True] * 3]


def test_torques_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    assert cell.load is not None
    tip, weight = model.body("tool").id, cell.load.mass * GRAVITY
    expected = np.empty((2, len(scene), 5))
    for n, data in enumerate(configurations(scene, model)):
        expected[:, n] = -data.qfrc_bias
        hook = data.xmat[tip].reshape(3, 3) @ cell.load.com + data.xpos[tip]
        mujoco.mj_applyFT(model, data, weight, np.zeros(3), hook, tip, expected[1, n])
    np.testing.assert_allclose(static_torques(scene), expected, atol=1e-6)
    allowed = {c.name: c for c in constraints_of(cell)}["joint_torque"].allows(scene)
    over = np.abs(expected) > np.nan_to_num(cell.robot.efforts, nan=1e9)
    np.testing.assert_array_equal(allowed, ~over.any(axis=(0, 2)))
    assert 0 < allowed.sum() < len(allowed)


def test_what_is_not_asked_is_not_computed() -> None:
    scene = scene_of(planar(), np.zeros((4, 3)))
    assert visible(scene).tolist() == [[True]] * 4
    assert not {"frames", "capsules", "markers"} & set(vars(scene))
    cell = shaped(1)
    nobody = scene_of(cell, np.empty((0, 5)))
    assert all(c.allows(nobody).shape == (0,) for c in constraints_of(cell))
    assert visible(nobody).shape == (0, 3)


FLOOR = {"type": "halfspace", "point_mm": (0, 0, -50), "normal": (0, 0, -1)}
ON_FLOOR = designed(planar(shapes=Shapes({"base": (LINK,)})), obstacle=[FLOOR])
DOWN = np.array([0.0, -9.0, 0.0])
HANGING = planar(load=Load(5.0, (0, 0, 0)), gravity=DOWN)
LIMITED = replace(HANGING, load=Load(5.0, (0, 0, 0), np.radians(30.0)))
HEAVY, EFFORTS = {"masses": np.full(3, 5.0)}, {"efforts": np.full(3, 10.0)}
EVERY = (
    "obstacle 1 (box), obstacle 2 (sphere), obstacle 3 (halfspace), self_collision, hanging_load"
)
NAMES: dict[str, tuple[Cell, str]] = {
    "nothing": (planar(), ""),
    "every kind": (shaped(1), f"joint_limits, {EVERY}, joint_torque"),
    "a base on the floor": (ON_FLOOR, ""),
    "efforts without weights": (planar(**EFFORTS), ""),
    "weights without efforts": (planar(**HEAVY), ""),
    "weights and efforts": (planar(**HEAVY, **EFFORTS), "joint_torque"),
    "a load and efforts": (planar(**EFFORTS, load=Load(1.0, (0, 0, 0))), "joint_torque"),
    "a load that hangs everywhere": (HANGING, ""),
    "a load of a largest tilt": (LIMITED, "hanging_load"),
    "the same without gravity": (replace(LIMITED, gravity=np.zeros(3)), ""),
    "the same without the load": (replace(LIMITED, load=None), ""),
}


@pytest.mark.parametrize("case", NAMES)
def test_constraints_that_a_cell_has_and_their_names(case: str) -> None:
    cell, names = NAMES[case]
    assert ", ".join(c.name for c in constraints_of(cell)) == names


def driven(effort: float, **given: Any) -> Cell:
    """Ten kilograms three metres ahead of the first joint, which holds so much, N m."""
    payload = Payload(10.0, (0.0, 0.0, 0.0))
    efforts = np.array([effort, np.nan, np.nan])
    return planar(efforts=efforts, gravity=DOWN, payload=payload, **given)


def before(**obstacle: Any) -> Cell:
    """An obstacle that begins 1.5 m from the base along y: one link does not reach it, two do."""
    return designed(planar(2, shapes=Shapes({"j1": (LINK,), "j2": (LINK,)})), obstacle=[obstacle])


BOX = {"center_mm": (0, 2500, 0), "size_mm": (2000, 200, 200), "rpy_deg": (0, 0, 90)}
# One metre up and then 1 m at 20 or 24 degrees: 0.34 or 0.41 m further up, 0.1 m thick.
CLEAR = [(90, 180), (-90, 0), (90, 90), (90, 70)]
ALLOWS: dict[str, tuple[Cell, list[tuple[float, ...]], list[tuple[float, ...]]]] = {
    "limits": (
        planar(limits=np.radians([[-90, 90], [-45, 45], [-10, 10]])),
        [(90, 45, 10), (-90, -45, -10), (90 + 1e-9, 45, 10)],
        [(90, 45, 10 + 1e-4), (-90 - 1e-4, -45, -10)],
    ),
    "a link on the floor": (
        replace(ON_FLOOR, shapes=Shapes({"base": (LINK,), "j1": (LINK,)})),
        [],
        [(0, 0, 0)],
    ),
    "a box": (before(type="box", **BOX), [*CLEAR, (90, 66)], [(90, 0)]),
    "a ball": (
        before(type="sphere", center_mm=(0, 2500, 0), radius_mm=1000),
        [*CLEAR, (90, 66)],
        [(90, 0)],
    ),
    "a wall": (
        before(type="halfspace", point_mm=(7, 1500, 7), normal=(0, 3, 0)),
        CLEAR,
        [(90, 0), (90, 66)],
    ),
    # Links 1 and 2 on top of each other are neighbours; folded twice, links 1 and 3 meet.
    "itself": (
        planar(shapes=Shapes({"j1": (LINK,), "j2": (LINK,), "j3": (LINK,)})),
        [(0, 0, 0), (0, 90, 135), (0, 90, 90)],
        [(0, 180, 0), (0, 170, 170), (0, 90, 150)],
    ),
    "a weight of 270 N m": (driven(300.0), [(0, 0, 0), (90, 0, 0)], []),
    "405 N m with the load": (
        driven(300.0, load=Load(5.0, (0, 0, 0))),
        [(90, 0, 0), (0, 120, 0)],
        [(0, 0, 0)],
    ),
    "a load on the other side": (driven(300.0, load=Load(5.0, (-9, 0, 0))), [(0, 0, 0)], []),
    "that load, and the free reading": (
        driven(200.0, load=Load(5.0, (-9, 0, 0))),
        [(90, 0, 0)],
        [(0, 0, 0)],
    ),
    "a load that tilts": (
        LIMITED,
        [(0, 0, 0), (29.9, 0, 0), (90, -60, 0), (150, 0, 0), (90, 90, 0)],
        [(30.1, 0, 0), (-40, 0, 0)],
    ),
    "axes along the weight": (replace(LIMITED, gravity=GRAVITY), [(30.1, 0, 0), (-40, 0, 0)], []),
}


@pytest.mark.parametrize("case", ALLOWS)
def test_what_the_one_constraint_of_a_cell_allows(case: str) -> None:
    """Poses of a planar arm of links of a metre, in degrees: those allowed, those refused."""
    cell, good, bad = ALLOWS[case]
    (only,) = constraints_of(cell)
    found = only.allows(scene_of(cell, np.radians([*good, *bad])))
    assert found.tolist() == [True] * len(good) + [False] * len(bad)


def test_drives_hold_what_hangs_on_both_sides_and_their_share_of_what_a_coupling_moves() -> None:
    cell, poses, _ = two_hands(1)
    robot = cell.robot
    frames = forward(robot, poses.q)
    loads = loads_of(robot, poses, cell.payload, cell.gravity)
    local = transmitted(robot, loads, frames, link_origins(robot, frames, poses.q)).local
    expected = np.einsum("mki,ki->mk", local[:, 1 : robot.dof + 1, 3:], robot.axes)
    for found in static_torques(scene_of(cell, poses.q)):  # free and loaded
        np.testing.assert_allclose(found, expected, atol=1e-10)
    level = Coupling("right1", (("hip", -0.5), ("torso", -1.0)), 0.0)
    tied = replace(cell, robot=replace(robot, couplings=(level,)))
    held, _ = static_torques(scene_of(tied, poses.q))
    hip, torso, right = (robot.joints.index(name) for name in ("hip", "torso", "right1"))
    share = np.zeros(robot.dof)
    share[[hip, torso]] = -0.5, -1.0
    np.testing.assert_allclose(held, expected + expected[:, [right]] * share, atol=1e-10)


def test_a_plan_of_both_arms_keeps_an_undriven_joint_in_place_and_in_its_limits() -> None:
    cell, _, _ = two_hands(0)
    limits = np.tile([-2.0, 2.0], (10, 1))
    level = Coupling("right1", (("hip", -1.0), ("torso", -1.0)), 0.1)
    robot = replace(cell.robot, couplings=(level,), limits=limits)
    cell = replace(
        cell,
        robot=robot,
        instruments=(Tracker(sigma=2e-5),),
        effects=("base", "tool", "joint_offset"),
    )
    assert (np.abs(robot.sobol(50)) <= 2.0).all()
    q = doe.design(cell, poses=6, criterion="D", candidates=40).poses.q
    np.testing.assert_allclose(q[:, 2], 0.1 - q[:, 0] - q[:, 1], atol=1e-9)
    assert (np.abs(q) <= 2.0 + 1e-9).all()


def test_sight_is_that_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    """Rays of MuJoCo from the instrument to the markers, shape by shape."""
    cell, scene, model = arm
    geoms = [*capsule_geoms(scene, model), model.geom("box").id, model.geom("ball").id]
    tip = model.body("tool").id
    expected = np.ones((len(scene), len(cell.markers)), dtype=bool)
    for n, data in enumerate(configurations(scene, model)):
        turn = data.xmat[tip].reshape(3, 3)
        for j, marker in enumerate(cell.markers @ turn.T + data.xpos[tip]):
            np.testing.assert_allclose(scene.markers[n, j], marker, atol=1e-9)
            for g in geoms:
                shape = (data.geom_xpos[g], data.geom_xmat[g], model.geom_size[g])
                kind = model.geom_type[g]
                beam = marker - cell.instrument
                met = mujoco.mju_rayGeom(*shape, cell.instrument, beam, kind, None)
                # A capsule that holds the marker does not hide it.
                x = (marker - shape[0]) @ shape[1].reshape(3, 3)
                x[2] -= np.clip(x[2], -shape[2][1], shape[2][1])
                inside = kind == CAPSULE and np.linalg.norm(x) <= shape[2][0]
                expected[n, j] &= not (0.0 <= met <= 1.0) or inside
    np.testing.assert_array_equal(visible(scene), expected)
    assert 0.05 < expected.mean() < 0.95


def watched(*stands: float, **given: Any) -> Cell:
    """Two links and a tracker that stands there, of which a marker at the tip's origin is read."""
    given = {"markers": np.zeros((1, 3))} | given
    return planar(2, instruments=read_by(stands=np.array(stands) if stands else None), **given)


SKIN = np.array([[0.1, -0.1, 0.0], [0.1, 0.0, 0.0], [0.1, -0.11, 0.0], [0.1, 0.11, 0.0]])
TOOL = Capsule((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), 0.1)
FACING = replace(  # normals along x of the tip; an acceptance of 30 degrees, none given, no normal
    watched(1e6, 0.0, 0.0, markers=np.zeros((3, 3))),
    marker_normals=np.array([[1.0, 0, 0], [1.0, 0, 0], [np.nan] * 3]),
    marker_acceptance=np.array([np.radians(30.0), np.nan, np.radians(1.0)]),
)
BEHIND = watched(5.0, 0.0, -0.3, markers=np.array([[0.0, 0.0, 0.1]]))
POST = {"type": "box", "center_mm": (3500, 0, 0), "size_mm": (100, 200, 800), "rpy_deg": (0, 0, 0)}
SPHERE = {"type": "sphere", "center_mm": (3500, 0, 0), "radius_mm": 100}
BELOW = {"type": "halfspace", "point_mm": (0, 0, -100), "normal": (0, 0, -1)}
FIRST = Shapes({"j1": (LINK,)})
SEEN: dict[str, tuple[Cell, dict[tuple[float, float], str]]] = {
    # On the skin of the tool and in it, behind it, before it.
    "markers in a tool": (
        watched(2.1, 5.0, 0.0, markers=SKIN, shapes=Shapes({"tool": (TOOL,)})),
        {(0, 0): "++-+"},
    ),
    "facing": (FACING, {(0, 0): "+++", (29.9, 0): "+++"}),
    "turned by more than 30 degrees": (FACING, {(0, -30.1): "-++", (89.9, 0): "-++"}),
    "turned away": (FACING, {(50, 40.1): "--+", (180, 0): "--+"}),
    "behind a box": (designed(BEHIND, obstacle=[POST]), {(0, 0): "-", (90, 0): "+"}),
    "behind a ball": (designed(BEHIND, obstacle=[SPHERE]), {(0, 0): "-", (90, 0): "+"}),
    "below a floor": (designed(BEHIND, obstacle=[BELOW]), {(0, 0): "+", (90, 0): "+"}),
    "from the box": (
        designed(BEHIND, obstacle=[POST | {"center_mm": (5000, 0, 0)}]),
        {(0, 0): "+"},
    ),
    "from nowhere": (designed(watched(), obstacle=[POST]), {(0, 0): "+"}),
    # The arm reaches to where the tracker stands.
    "in a link": (watched(0.5, 0, 0, shapes=FIRST), {(0, 0): "-", (180, 0): "-", (90, 0): "+"}),
}


@pytest.mark.parametrize("case", SEEN)
def test_what_is_seen(case: str) -> None:
    """By poses of the planar arm, in degrees, a sign for each marker."""
    cell, expected = SEEN[case]
    seen = visible(scene_of(cell, np.radians([*expected])))
    assert ["".join("+" if one else "-" for one in row) for row in seen] == [*expected.values()]
