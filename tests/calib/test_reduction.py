"""The irreducible geometry: ranks of the KR 270, and completeness on chains of any kind."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib import Cell
from calib.build import build
from calib.model import Model
from calib.poses import poses_at
from calib.reduction import generic_configurations
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
    rigid = [f"link_geometry:{joint}" for joint in kr270.robot.joints]
    full = build(with_effects(cell, "base", "tool", *rigid)).model
    everything = scaled_matrix(full)
    wanted = {f"link_geometry:{j}.{c}" for j, names in published.items() for c in names.split()}
    assert len(wanted) == 18
    ours = np.linalg.matrix_rank(reduced, tol=1e-6)
    both = np.linalg.matrix_rank(np.hstack([reduced, everything]), tol=1e-6)
    assert ours == both == 33


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
    from calib.build import context_of
    from calib.effects import EFFECTS

    context = context_of(cell, None)
    return [EFFECTS[kind].at(context, where) for where in EFFECTS[kind].places(context)]


def test_every_dropped_parameter_is_explained(kr270: Cell) -> None:
    cell = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    dropped = build(cell).dropped
    assert len(dropped) == 42 - 18
    names = {d.id: {name for name, _ in d.absorbed_by} for d in dropped}
    assert "base:base.z" in names["geometry:A1.z"]
    assert names["geometry:tool0.x"] == {f"tool:m{j}.x" for j in (1, 2, 3)}


def test_known_base_and_markers_leave_more_to_identify(kr270: Cell) -> None:
    """Without base and tool in the model a 6R arm has all 30 pose parameters."""
    cell = cell_of(kr270.robot, MARKERS, ["geometry"])
    assert len(calib.parameters(cell)) == 30


def test_joint_offset_beside_geometry_is_part_of_it(kr270: Cell) -> None:
    plain = cell_of(kr270.robot, MARKERS, ["base", "tool", "geometry"])
    doubled = with_effects(plain, "base", "tool", "geometry", "joint_offset")
    assert len(calib.parameters(doubled)) == 33
