"""Instruments on links of a two-armed robot: what they read is what lies between, and no more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.cell.cell import Cell, Repeatability
from calib.errors import EffectCannotAct, InputError
from calib.files.cell import load_cell
from calib.instruments import ArmCamera
from calib.model import Model
from calib.model.build import build
from calib.observations.scatter import Variances, scatter_of
from calib.poses import Poses, poses_at
from doe.candidates import drawn
from doe.constraints import scene_of, visible
from tests.helpers import all_seen
from tests.two_arms import COMMON, EYE, PLATE, in_view, written

ON_HAND = '[markers_mm]\nm = [90, 20, 30]\nn = { position = [0, 50, 10], on = "left_hand" }\n'
ON_WALL = PLATE.replace('"tip"', '"world"').replace("[-40, -30, -20]", "[500, 0, 800]")
SECOND = ON_WALL.replace("plate", "wall")
KINDS = {
    "points": 'kind = "points"\nsigma_mm = 0.01',
    "distance": 'kind = "distance"\nsigma_mm = 0.01\nanchor_mm = [20, 10, 30]\noffset = true',
    "pose": 'kind = "pose"\nsigma_mm = 0.01\nsigma_urad = 20',
}
LASER = '[instruments.laser]\nkind = "points"\nsigma_mm = 0.01\n'


def identified(
    cell: Cell, poses: Poses, seen: Array | None = None
) -> tuple[calib.Identification, Model]:
    """A result of readings without noise at random values, which come out."""
    model = build(cell, poses).model
    draws = np.random.default_rng(0).normal(size=len(model.parameters))
    values = model.initial + 0.3 * draws * model.sizes
    data = all_seen(poses, model.predict(values, poses))
    found = calib.identify(cell, data if seen is None else replace(data, seen=seen))
    np.testing.assert_allclose((found.values - values) / model.sizes, 0.0, atol=1e-6)
    return found, model


def anywhere(cell: Cell, count: int) -> Poses:
    rng = np.random.default_rng(1)
    return poses_at(rng.uniform(-1.2, 1.2, (count, cell.robot.dof)))


def test_a_camera_on_the_head_tells_what_lies_between_it_and_the_hand(tmp_path: Path) -> None:
    """Of the joints that carry both it is said that nothing tells them."""
    cell = load_cell(written(tmp_path, PLATE, EYE))
    found, _ = identified(cell, in_view(cell, 60))
    assert found.status == "converged"
    (untold,) = found.unidentifiable
    assert {name.split(":")[1].split(".")[0] for name in untold.names} == {*COMMON}
    assert len(untold.names) == 6 * len(COMMON)
    assert untold.reason == (
        "they move nothing that is read against the instrument that reads it, so no reading at any "
        "pose tells them, and errors at targets are without theirs"
    )
    assert cell.unseen_joints == COMMON
    places = [p.id for p in found.model.parameters[:12]]
    assert (places[0], places[6]) == ("base:eye.x", "tool:body:plate.x")


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_that_rides_tells_what_lies_between(tmp_path: Path, kind: str) -> None:
    read = '[bodies.hand]\non = "left_hand"\n' if kind == "pose" else ON_HAND
    eye = f'[instruments.eye]\non = "right_hand"\n{KINDS[kind]}\n'
    cell = load_cell(written(tmp_path, read, eye))
    assert cell.instruments[0].seat is not None
    identified(cell, anywhere(cell, 150))


def test_a_camera_on_any_link_sees_boards_in_the_world(tmp_path: Path) -> None:
    """As one on the tip does: the camera is a body of its link, and the board has the place."""
    cell = load_cell(written(tmp_path, ON_WALL, EYE.replace('"head"', '"left_hand"')))
    (camera,) = cell.instruments
    assert isinstance(camera, ArmCamera)
    assert camera.seat is None
    assert set(cell.marker_links) == {"left_hand"}
    _, model = identified(cell, in_view(cell, 60))
    assert {"base:eye.x", "tool:body:eye.rz"} <= {p.id for p in model.parameters}


@pytest.mark.long
def test_a_board_on_the_base_tells_the_head_of_the_torso(tmp_path: Path) -> None:
    """One camera, of a board in the hand and of one that stands beside the robot."""
    wall = SECOND.replace('"world"', '"base"').replace("[0, 0, 0]", "[0, 90, 0]")
    wall = wall.replace("[500, 0, 800]", "[900, 100, 1100]").replace("= 20", "= 40")
    cell = load_cell(written(tmp_path, PLATE, wall, EYE))
    q = np.concatenate(list(drawn(cell, 3000, None, 0)))
    seen = visible(scene_of(cell, q))
    each = [np.flatnonzero(seen[:, own].all(axis=1))[:40] for own in (slice(20), slice(20, None))]
    chosen = np.concatenate(each)
    found, model = identified(cell, poses_at(q[chosen]), seen[chosen])
    assert not found.unidentifiable
    assert {p.where for p in model.parameters} >= {"bend", "body:wall", "body:plate", "eye"}


def test_a_tracker_tells_of_the_torso_what_the_head_cannot(tmp_path: Path) -> None:
    """A tracker in the world and the camera on the head, in one fit."""
    both = load_cell(written(tmp_path, ON_HAND, PLATE, EYE, LASER))
    found, model = identified(both, in_view(both, 60))
    assert {p.where for p in model.parameters} >= {"bend", "pan", "tilt", "left3"}
    assert not found.unidentifiable


def test_a_named_effect_that_moves_all_alike_is_refused(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, PLATE, EYE, effects='"base", "tool", "joint_offset:hip"'))
    with pytest.raises(EffectCannotAct, match="moves nothing that is read against the instrument"):
        build(cell)


PLANE = '[instruments.table]\nkind = "plane"\non = "head"\nsigma_mm = 0.01\n'
TOUCHED = ("[markers_mm]\nm = [1, 2, 3]\n", f'[instruments.i]\non = "tip"\n{KINDS["points"]}\n')


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ((ON_HAND, PLANE), "a plane rides on no link; take out on = 'head'"),
        ((PLATE.replace('"tip"', '"head"'), EYE),
         "has camera eye and nothing that it sees; add [boards.NAME] with on = 'world'"),
        ((PLATE, SECOND, EYE), "has camera eye, that sees boards in the world and on other links"),
        ((PLATE, EYE + 'boards = ["p"]\n'), "camera eye, whose board p is none of [boards]"),
        ((PLATE, EYE.replace('"head"', '"hat"')), "has no link 'hat'; set 'on' of what it carries"),
        (TOUCHED, "instruments.i.on: rides on tip as all does that it reads; name another link"),
    ],
)  # fmt: skip
def test_what_cannot_ride_is_said_in_one_line(
    tmp_path: Path, tables: tuple[str, ...], said: str
) -> None:
    with pytest.raises(InputError) as error:
        load_cell(written(tmp_path, *tables))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_cameras_may_say_which_boards_they_look_at(tmp_path: Path) -> None:
    """And the tip may be named by its link."""
    palm = EYE.replace("instruments.eye", "instruments.palm").replace('"head"', '"left_hand"')
    eye = EYE + 'boards = ["plate"]\n'
    cell = load_cell(written(tmp_path, PLATE, SECOND, eye, palm + 'boards = ["wall"]\n'))
    assert cell.instruments[0].seat is not None
    assert isinstance(cell.instruments[1], ArmCamera)
    assert cell.marker_links == (3 * ("left_hand",) + 20 * ("right_hand",) + 3 * ("head",))
    cell = load_cell(written(tmp_path, PLATE.replace('"tip"', '"right_hand"'), EYE))
    assert cell.robot.tips == ("head", "right_hand")


def test_the_hand_scatters_before_the_head_that_reads_it(tmp_path: Path) -> None:
    """The repeatability of a cell is how a tip comes back before what reads it, however that rides."""
    body = '[bodies.hand]\non = "left_hand"\n[instruments.eye]\n'
    pose = f'on = "head"\n{KINDS["pose"].replace("0.01", "1e-6").replace("20", "1e-3")}\n'
    cell, arm = load_cell(written(tmp_path, body, pose)), Repeatability(3e-5, 2e-5)
    own, poses = replace(cell, repeatability=arm), anywhere(cell, 4000)
    model = build(cell, poses).model
    read, still = (calib.simulate(c, poses, model.initial, rng=1).readings for c in (own, cell))
    (instrument,) = cell.instruments
    found = instrument.shown(read, read - still).reshape(-1, 6).std(axis=0)
    np.testing.assert_allclose(found, [3e-5] * 3 + [2e-5] * 3, rtol=0.05)
    known = scatter_of(model, model.initial, poses, Variances.of_arm(cell.robot.dof, arm))
    size = np.sqrt((known.levers[..., :3, :] ** 2 * known.variances.approach[known.kinds]).sum(-1))
    np.testing.assert_allclose(size, 3e-5, rtol=1e-9)
