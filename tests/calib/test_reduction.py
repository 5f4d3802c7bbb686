"""The irreducible geometry: ranks of the KR 270, and completeness on chains of any kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell
from calib.effects.geometry import LinkGeometry
from calib.errors import EffectCannotAct
from calib.model import Model
from calib.model.build import build, context_of
from calib.model.reduction import generic_configurations
from calib.poses import poses_at
from tests.helpers import cell_of, random_robot, with_effects

MARKERS = np.array(
    [[0.2792, -0.0164, -0.0919], [0.2792, -0.0252, 0.0961], [0.2818, 0.1305, 0.0056]]
)


def scaled_matrix(model: Model) -> np.ndarray:
    poses = poses_at(generic_configurations(model.robot, 60) * 0.9)
    _, J = model.jacobian(np.zeros(len(model.parameters)), poses)
    J = J.reshape(-1, J.shape[-1])
    return J / np.linalg.norm(J, axis=0)


@pytest.mark.parametrize(("markers", "rank"), [(1, 27), (2, 30), (3, 33)])
def test_rank_of_the_kr270(kr270: Cell, markers: int, rank: int) -> None:
    cell = cell_of(kr270.robot, MARKERS[:markers], ["base", "tool", "geometry"])
    assert len(calib.parameters(cell)) == rank
    singular = np.linalg.svd(scaled_matrix(build(cell).model), compute_uv=False)
    assert singular[0] / singular[-1] < 100.0, "and the chosen set is well conditioned"


def test_published_set_spans_the_same(kr270: Cell) -> None:
    """The 18 parameters of the RCIM 2015 companion paper move the markers as the reduced set does."""
    published = {
        "A2": "x y rx ry",
        "A3": "x rx rz ry",
        "A4": "x z rz rx",
        "A5": "y z rz ry",
        "A6": "z rz",
    }
    cell = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    reduced = scaled_matrix(build(cell).model)
    context = context_of(cell, None)
    placed = [e for kind in ("base", "tool") for e in _all(kind, cell)]
    for joint, names in published.items():
        components = tuple(LinkGeometry.names.index(name) for name in names.split())
        placed.append(replace(LinkGeometry.at(context, joint), components=components))
    theirs = scaled_matrix(build(cell).model.with_effects(tuple(placed)))
    assert theirs.shape[1] == 33
    for X in (theirs, reduced, np.hstack([theirs, reduced])):
        assert np.linalg.matrix_rank(X, tol=1e-6) == 33


@pytest.mark.parametrize(
    ("dof", "prismatic"), [(1, ()), (2, ()), (3, (1,)), (5, ()), (7, ()), (6, (0, 3)), (9, ())]
)
@pytest.mark.parametrize("markers", [1, 3])
def test_reduced_set_is_complete_and_irreducible(
    dof: int, prismatic: tuple[int, ...], markers: int
) -> None:
    """Against the rank of all six errors of every segment, with base and markers."""
    rng = np.random.default_rng(dof)
    robot = random_robot(rng, dof, prismatic)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), ["base", "tool", "geometry"])
    reduced = build(cell).model
    X = scaled_matrix(reduced)
    assert np.linalg.matrix_rank(X, tol=1e-7) == X.shape[1]
    full = reduced.with_effects(
        tuple(e for kind in ("base", "tool", "geometry") for e in _all(kind, cell))
    )
    assert np.linalg.matrix_rank(scaled_matrix(full), tol=1e-7) == X.shape[1]


def _all(kind: str, cell: Cell):  # type: ignore[no-untyped-def]
    from calib.effects import EFFECTS
    from calib.model.build import context_of

    context = context_of(cell, None)
    return [EFFECTS[kind].at(context, where) for where in EFFECTS[kind].places(context)]


def test_rounding_does_not_choose_between_equals(kr270: Cell) -> None:
    """Of two shifts that are one, the same stays whatever the last digits of the model are."""
    rng, found = np.random.default_rng(0), set()
    for _ in range(6):
        origins = kr270.robot.origins * (1.0 + 1e-15 * rng.standard_normal((7, 4, 4)))
        robot = replace(kr270.robot, origins=origins)
        cell = cell_of(robot, MARKERS, ["base", "tool", "geometry"])
        found.add(tuple(calib.parameters(cell)))
    assert len(found) == 1


def test_every_dropped_parameter_is_explained(kr270: Cell) -> None:
    cell = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    dropped = build(cell).dropped
    assert len(dropped) == 42 - 18
    names = {d.id: {name for name, _ in d.absorbed_by} for d in dropped}
    assert "base:base.z" in names["geometry:A1.z"]
    assert names["geometry:tool0.x"] == {f"tool:marker:m{j}.x" for j in (1, 2, 3)}


def test_known_base_and_markers_leave_more_to_identify(kr270: Cell) -> None:
    """Without base and tool in the model a 6R arm has all 30 pose parameters."""
    cell = cell_of(kr270.robot, MARKERS, ["geometry"])
    assert len(calib.parameters(cell)) == 30


def test_joint_offset_beside_geometry_is_part_of_it(kr270: Cell) -> None:
    plain = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    doubled = with_effects(plain, "base", "tool", "geometry", "joint_offset")
    assert len(calib.parameters(doubled)) == 33


def test_an_offset_that_the_base_absorbs_is_refused_where_it_was_asked_for(kr270: Cell) -> None:
    cell = cell_of(kr270.robot, MARKERS, ["base", "joint_offset:A1"])
    with pytest.raises(EffectCannotAct, match=r"base:base.rz moves the markers in the same way"):
        build(cell)


@pytest.mark.parametrize("effects", [("base", "tool"), ("base", "tool", "geometry")])
def test_markers_and_base_of_an_arm_in_a_plane_are_reduced_too(effects: tuple[str, ...]) -> None:
    """A SCARA cannot tell the height of its markers from that of its base."""
    rng = np.random.default_rng(0)
    robot = random_robot(rng, 3, prismatic=(2,))
    flat = replace(robot, axes=np.tile([0.0, 0.0, 1.0], (3, 1)), origins=robot.origins.copy())
    flat.origins[:, :3, :3] = np.eye(3)
    model = build(cell_of(flat, rng.uniform(-0.2, 0.2, (3, 3)), effects)).model
    X = scaled_matrix(model)
    assert np.linalg.matrix_rank(X, tol=1e-7) == X.shape[1]


PLACES = ("A2", "A4", "tool0")


@pytest.mark.parametrize("ends", [("base", "tool"), ("tool",), ()])
def test_geometry_at_places_is_what_can_be_told_apart_there(
    kr270: Cell, ends: tuple[str, ...]
) -> None:
    """As many as the rank of six constants at each of these frames beside base and markers."""
    cell = cell_of(kr270.robot, MARKERS, [*ends, f"geometry:{','.join(PLACES)}"])
    built = build(cell)
    assert {p.where for p in built.model.parameters if p.effect == "geometry"} <= {*PLACES}
    assert {e.where for e in built.full.effects if e.kind == "geometry"} == {*PLACES}
    X = scaled_matrix(built.full)
    rank = np.linalg.matrix_rank(X, tol=1e-6)
    kept = scaled_matrix(built.model)
    assert len(built.model.parameters) == rank == np.linalg.matrix_rank(kept, tol=1e-6)


def test_geometry_everywhere_is_geometry_at_every_place(kr270: Cell) -> None:
    whole = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    every = f"geometry:{','.join((*kr270.robot.joints, kr270.robot.tip))}"
    named = calib.parameters(with_effects(whole, "base", "tool", every))
    assert named == calib.parameters(whole)


def test_geometry_that_others_absorb_at_every_place_is_refused(kr270: Cell) -> None:
    cell = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry:A1"])
    with pytest.raises(EffectCannotAct, match=r"geometry cannot act: base:base.* move the markers"):
        build(cell)
    build(with_effects(cell, "base", "tool", "geometry:A1,A2"))
