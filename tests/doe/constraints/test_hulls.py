"""Meshes as obstacles: distances to their hulls against a least-squares solver, ways against both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

import calib
from calib.arrays import Array
from calib.cell.planned import Ball, Box, Hull
from calib.errors import InputError
from calib.files.shapes import hull_of
from doe.constraints import Constraint, constraints_of, scene_of
from doe.constraints.clearance import Clearance
from doe.constraints.obstacles import Obstacle
from doe.day.straight import straight
from tests.doe.constraints.arms import shaped
from tests.studies.command_line import paper_cell

_WEIGHT = 1e4


def drawn(seed: int, at: Array | float = 0.0) -> Hull:
    points = np.random.default_rng(seed).normal(size=(30, 3)) * 0.2 + at
    return Hull(hull_of(points, Path("a.stl")), Path("a.stl"))


def apart(start: Array, end: Array, points: Array) -> float:
    """Distance of a segment to the hull of points: both as convex combinations (NNLS)."""
    A = np.hstack([np.column_stack([start, end]), -points.T])
    sums = _WEIGHT * np.vstack(
        [np.r_[1.0, 1.0, np.zeros(len(points))], np.r_[0.0, 0.0, np.ones(len(points))]]
    )
    weights, _ = nnls(np.vstack([A, sums]), np.r_[0.0, 0.0, 0.0, _WEIGHT, _WEIGHT])
    return float(np.linalg.norm(A @ weights))


@pytest.mark.parametrize("seed", range(4))
def test_distances_against_least_squares(seed: int) -> None:
    hull, rng = drawn(seed), np.random.default_rng([seed, 1])
    start, end = rng.normal(size=(2, 60, 3)) * 0.7
    start[0] = end[0]  # a point
    found = Obstacle("mesh", hull).from_segment(start, end, 10.0)
    expected = np.array([apart(a, b, hull.points) for a, b in zip(start, end, strict=True)])
    assert (found <= expected + 1e-7).all()  # at most the distance
    np.testing.assert_allclose(found, expected, atol=3e-5)
    assert (found == 0.0).any()
    bounded = Obstacle("mesh", hull).from_segment(start, end)
    assert (bounded <= found + 1e-12).all()
    np.testing.assert_array_equal(bounded > 0.0, found > 0.0)


def test_a_box_as_a_mesh_is_a_box() -> None:
    half = np.array([0.3, 0.2, 0.1])
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
    mesh = Obstacle("mesh", Hull(hull_of(corners, Path("a.stl")), Path("a.stl")))
    box = Obstacle("box", Box(np.eye(4), half))
    rng = np.random.default_rng(0)
    start, end = rng.uniform(-1.0, 1.0, (2, 200, 3))
    np.testing.assert_allclose(
        mesh.from_segment(start, end, 10.0), box.from_segment(start, end), atol=3e-5
    )


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_missed_on_a_proved_way(seed: int) -> None:
    """Proved motions at 200 places each: no capsule within its radius of the hull, by least squares."""
    arm = shaped(seed)
    hull = drawn(seed, [0.7, 0.4, 0.4])
    cell = replace(arm, design=replace(arm.design, obstacles=(hull,)))
    (kept,) = (own for own in constraints_of(cell) if isinstance(own, Obstacle))
    low, high = cell.robot.limits.T
    ends = np.random.default_rng(seed).uniform(low, high, (2, 200, cell.robot.dof))
    found = straight(cell, [kept], *ends)
    assert 3 <= found.free.sum() <= 190
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for i in np.flatnonzero(found.free)[:3]:
        scene = scene_of(cell, ends[0][i] + share * (ends[1][i] - ends[0][i]))
        for capsule in (own for own in scene.capsules if own.moves):
            for a, b in zip(capsule.start[::5], capsule.end[::5], strict=True):
                assert apart(a, b, hull.points) > capsule.radius
    for i in np.flatnonzero(~found.free)[:10]:
        at = ends[0][i] + found.at[i] * (ends[1][i] - ends[0][i])
        scene = scene_of(cell, at[None])
        gaps = [
            apart(own.start[0], own.end[0], hull.points) - own.radius
            for own in scene.capsules
            if own.moves
        ]
        assert min(gaps) < 1e-3


def test_a_mesh_beside_the_cell(tmp_path: Path) -> None:
    """A tetrahedron in millimetres, turned and moved; its file is one of the cell's."""
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\n")
    cell = paper_cell(tmp_path)
    more = (
        '\n[[design.obstacle]]\ntype = "mesh"\nfile = "t.obj"\nunit = "mm"\n'
        "position_mm = [1000, 0, 0]\nrpy_deg = [0, 0, 90]\n"
    )
    cell.write_text(cell.read_text() + more)
    found = calib.load_cell(cell)
    (body,) = found.design.obstacles
    assert isinstance(body, Hull)
    corners = {tuple(own) for own in (body.points * 1e3).round(6).tolist()}
    assert corners == {(1000, 0, 0), (1000, 100, 0), (900, 0, 0), (1000, 0, 100)}
    assert tmp_path / "t.obj" in found.named_files
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\n")
    with pytest.raises(InputError, match=r"t\.obj: has no volume; bring a solid, or a box"):
        calib.load_cell(cell)


def test_it_is_a_clearance_like_others() -> None:
    own = Obstacle("mesh", drawn(0))
    assert isinstance(own, Clearance)
    assert isinstance(own, Constraint)
    assert own.ball is not None
    centre, radius = own.ball
    round_about = Obstacle("ball", Ball(centre, radius))
    q = np.random.default_rng(0).normal(size=(50, 3))
    assert (round_about.from_point(q) <= own.from_point(q, 10.0) + 3e-5).all()
