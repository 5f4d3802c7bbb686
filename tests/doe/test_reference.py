"""The reference pose of a plan: where it is repeated, which one it is, and what it adds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
import doe
from calib import Cell, readings
from calib.cell.planned import Planned
from calib.errors import CalibError
from calib.files.cell import load_cell
from calib.files.write_tables import plan_csv
from calib.model.build import build
from doe.constraints import scene_of, visible
from doe.visiting import spacing, with_reference
from studies.design.record import design_record
from tests.helpers import MADE_FROM, read_by, with_effects
from tests.studies.command_line import paper_cell

ELASTIC = ("joint_compliance:A2,A3,A4,A5,A6",)
LEVELS = "A2=-100,-20x4"
QUICK = {"candidates": 300, "refine": False}


@pytest.fixture(scope="module")
def elastic(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *ELASTIC), design=Planned())


@pytest.fixture(scope="module")
def plain(elastic: Cell) -> doe.Design:
    return doe.design(elastic, levels=LEVELS, criterion="D", **QUICK)


@pytest.mark.parametrize(
    ("every", "places"),
    [(3, (0, 4, 8, 11)), (4, (0, 5, 10)), (8, (0, 9)), (100, (0, 9)), (1, range(0, 17, 2))],
)
def test_it_stands_at_the_start_after_every_so_many_and_at_the_end(
    plain: doe.Design, every: int, places: tuple[int, ...]
) -> None:
    poses, reference = with_reference(plain.problem, plain.poses, every)
    repeats = [i for i, name in enumerate(poses.names) if name in reference.repeats]
    assert repeats == list(places)
    assert reference.repeats == tuple(f"ref{k + 1}" for k in range(len(places)))
    own = poses.take(np.setdiff1d(np.arange(len(poses)), places))
    assert own.names == plain.poses.names
    np.testing.assert_array_equal(own.q, plain.poses.q)
    there = poses.configuration == poses.configuration[poses.names.index(reference.pose)]
    assert list(np.flatnonzero(there)) == sorted([*places, poses.names.index(reference.pose)])


def test_its_repeats_add_most(elastic: Cell, plain: doe.Design) -> None:
    """Of the determinant of the information, by the observation matrices alone."""
    _, reference = with_reference(plain.problem, plain.poses, 3)
    q = plain.poses.q
    J = calib.observation(elastic, q)
    J = J / np.linalg.norm(J, axis=(0, 1))
    total = np.einsum("mrp,mrq->pq", J, J)
    sums = [np.linalg.slogdet(total + 4.0 * rows.T @ rows)[1] for rows in J]
    assert reference.pose == plain.poses.names[int(np.argmax(sums))]


@pytest.mark.long
def test_its_repeats_count_in_what_is_expected(tmp_path: Path) -> None:
    """The cell asks for it, the plan comes back from its file, and the covariance holds it."""
    path = paper_cell(tmp_path)
    path.write_text(path.read_text().replace("\n[design] ", "\n[design]\nreference_every = 5\n#"))
    cell = with_effects(load_cell(path), *ELASTIC)
    assert spacing(cell, 0) == 0
    plan = doe.design(cell, levels=LEVELS, **QUICK)
    (tmp_path / "best.csv").write_text(plan_csv(cell, plan.poses, np.degrees(plan.level)))
    again = calib.load_plan(cell, tmp_path / "best.csv")
    assert again.names == plan.poses.names
    assert sorted(np.bincount(again.configuration)) == [1] * 7 + [4]
    fields = design_record(plan, MADE_FROM).model_dump()
    assert [pose["pose"] for pose in fields["poses"]] == list(again.names)
    assert (fields["reference"]["every"], fields["reference"]["poses"]) == (
        5,
        ("ref1", "ref2", "ref3"),
    )
    at = {pose["pose"]: pose["joints_deg"] for pose in fields["poses"]}
    for name in ("ref1", "ref2", "ref3", fields["reference"]["pose"]):
        assert at[name] == fields["reference"]["joints_deg"]
    model = build(cell, readings(cell, plan.poses)).model
    J = calib.observation(cell, plan.poses).reshape(-1, len(model.parameters)) / cell.noise.along
    np.testing.assert_allclose(
        plan.assessment.std, np.sqrt(np.diag(np.linalg.inv(J.T @ J))), rtol=1e-6
    )
    assert fields["task_rms_mm"] < fields["value"]


def test_it_shows_the_most_markers(plain: doe.Design, elastic: Cell) -> None:
    """Markers that face one way: the pose that adds most hides some, and is passed over."""
    _, free = with_reference(plain.problem, plain.poses, 4)
    best = plain.poses.names.index(free.pose)
    scene = scene_of(elastic, plain.poses.q)
    behind = scene.markers[best, 0] - 3.0 * scene.frames.R[best, -1, :, 2]
    turned = replace(
        elastic,
        instruments=read_by(stands=behind),
        marker_normals=np.tile([0.0, 0.0, 1.0], (3, 1)),
        marker_acceptance=np.full(3, np.pi / 2),
    )
    seen = visible(scene_of(turned, plain.poses.q)).sum(axis=1)
    assert seen[best] < seen.max()
    problem = replace(plain.problem, cell=turned)
    _, reference = with_reference(problem, plain.poses, 4)
    assert seen[plain.poses.names.index(reference.pose)] == seen.max()


def test_less_than_none_is_refused(elastic: Cell) -> None:
    with pytest.raises(CalibError, match="reference every -1 poses"):
        doe.design(elastic, poses=7, reference_every=-1, **QUICK)
