"""Which markers the instrument sees, against MuJoCo and by hand."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from calib import Cell
from calib.arm.robot import Capsule, Shapes
from doe.constraints import scene_of, visible
from doe.constraints.scene import Scene
from tests.doe.constraints.arms import (
    CAPSULE,
    capsule_geoms,
    configurations,
    planar,
    sees,
    shaped,
)
from tests.helpers import designed, read_by


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


def test_marker_in_the_capsule_of_the_tool() -> None:
    """Markers on the skin of the tool and in it are seen, one behind it is not."""
    tool = Capsule((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), 0.1)
    cell = planar(
        2,
        shapes=Shapes({"tool": (tool,)}),
        instruments=read_by(stands=np.array([2.1, 5.0, 0.0])),
        markers=np.array([[0.1, -0.1, 0.0], [0.1, 0.0, 0.0], [0.1, -0.11, 0.0], [0.1, 0.11, 0.0]]),
    )
    assert sees(cell, (0, 0)) == [[True, True, False, True]]


def test_marker_turned_away() -> None:
    """Normals along x of the tip; an acceptance of 30 degrees, none given, and no normal."""
    cell = planar(
        2,
        instruments=read_by(stands=np.array([1e6, 0.0, 0.0])),
        markers=np.zeros((3, 3)),
    )
    cell = replace(
        cell,
        marker_normals=np.array([[1.0, 0, 0], [1.0, 0, 0], [np.nan] * 3]),
        marker_acceptance=np.array([np.radians(30.0), np.nan, np.radians(1.0)]),
    )
    assert sees(cell, (0, 0), (29.9, 0), (0, -30.1), (89.9, 0), (50, 40.1), (180, 0)) == [
        [True, True, True],
        [True, True, True],
        [False, True, True],
        [False, True, True],
        [False, False, True],
        [False, False, True],
    ]


def test_obstacles_in_the_line_of_sight() -> None:
    """A box and a ball hide what lies behind them, a half-space and what holds the instrument not."""
    box = {
        "type": "box",
        "center_mm": (3500, 0, 0),
        "size_mm": (100, 200, 800),
        "rpy_deg": (0, 0, 0),
    }
    ball = {"type": "sphere", "center_mm": (3500, 0, 0), "radius_mm": 100}
    floor = {"type": "halfspace", "point_mm": (0, 0, -100), "normal": (0, 0, -1)}
    cell = planar(2, instruments=read_by(stands=np.array([5.0, 0.0, -0.3])))
    for obstacle, hidden in ((box, True), (ball, True), (floor, False)):
        scene = designed(cell, obstacle=[obstacle])
        assert sees(scene, (0, 0), (90, 0)) == [[not hidden], [True]], obstacle["type"]
    stand = dict(box, center_mm=(5000, 0, 0))
    assert sees(designed(cell, obstacle=[stand]), (0, 0)) == [[True]]


def test_all_are_seen_without_instrument() -> None:
    cell = replace(shaped(1), instruments=read_by())
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (50, 5))
    assert visible(scene_of(cell, q)).all()
    hidden = replace(cell, instruments=read_by(stands=np.array([3.0, 1.0, 0.5])))
    assert not visible(scene_of(hidden, q)).all()
