"""What every plan has beside its poses, and how many poses a model needs at least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import doe
from calib import Cell
from calib.cell.planned import Planned
from calib.inference.widths import SizePrior
from calib.model.build import build
from calib.poses import poses_at
from doe.candidates import Pool
from doe.planning import choose
from doe.problem import RIDGE, Problem, problem_of
from doe.request import CannotIdentify, Request
from studies.demo.embedded import embedded_cell


@pytest.fixture(scope="module")
def cell() -> Cell:
    effects = ("base", "tool", "geometry")
    return replace(embedded_cell(), effects=effects, load=None, knots={}, design=Planned())


def of_known_sizes(cell: Cell, width: float) -> tuple[Cell, SizePrior]:
    """The cell that states how large errors of its constants are, mm and mrad, and what that says."""
    known = replace(cell, size_prior={"geometry_mrad": width, "geometry_mm": width})
    prior = build(known).model.own_prior
    assert prior is not None
    return known, prior


def in_si(problem: Problem, M: np.ndarray) -> np.ndarray:
    """Information in the coordinates of the criteria, of the values in SI."""
    back = np.linalg.inv(problem.regressor.T)
    return np.asarray(back.T @ M @ back)


def test_what_sizes_tell_is_in_every_plan(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 1.0)
    cov = prior.covariance
    problem = problem_of(known, Request(6, "task"))
    ridge = RIDGE * np.eye(len(problem.fixed))
    told = in_si(problem, problem.fixed - ridge)
    at = np.array([p.effect == "geometry" for p in problem.model.parameters])
    np.testing.assert_allclose(told[np.ix_(at, at)] @ cov, np.eye(len(cov)), atol=1e-6)
    assert np.abs(told[~at]).max() < 1e-6 * np.abs(told).max()


def test_what_is_measured_in_any_case_adds_up(cell: Cell) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(*cell.robot.sample_limits().T, (3, cell.robot.dof))
    problem = problem_of(cell, Request(6, "task", fixed=poses_at(q)))
    _, J = problem.model.jacobian(problem.regressor.values, poses_at(q))
    rows = J.reshape(-1, J.shape[-1]) / cell.noise.along
    ridge = RIDGE * np.eye(len(problem.fixed))
    told = in_si(problem, problem.fixed - ridge) * np.outer(
        problem.model.sizes, problem.model.sizes
    )
    own = rows * problem.model.sizes
    np.testing.assert_allclose(told, own.T @ own, rtol=1e-6, atol=1e-6 * np.abs(told).max())


def pool(cell: Cell) -> tuple[Problem, Pool]:
    rng = np.random.default_rng(2)
    q = rng.uniform(*cell.robot.sample_limits().T, (200, cell.robot.dof))
    problem = problem_of(cell, Request(8, "D", candidates=poses_at(q)))
    return problem, problem.candidates()


def test_a_number_of_poses_is_refused_just_where_no_plan_of_it_tells_all(cell: Cell) -> None:
    """By the rank of random plans, which is that of the best where poses lie in general."""
    problem, found = pool(cell)
    p, rng = len(problem.model.parameters), np.random.default_rng(3)
    enough = next(
        n
        for n in range(1, 12)
        if max(
            np.linalg.matrix_rank(
                problem.information(found.q[rng.choice(len(found), n, replace=False)]).sum(axis=0),
                tol=1e-6,
            )
            for _ in range(20)
        )
        == p
    )
    few = replace(problem, request=replace(problem.request, poses=enough - 1))
    with pytest.raises(CannotIdentify, match=f"{enough - 1} poses leave .* parameters open"):
        choose(few, found)
    choose(replace(problem, request=replace(problem.request, poses=enough)), found)


def test_a_plan_beside_known_sizes_needs_fewer_poses_and_keeps_its_proof(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 0.02)
    std = prior.std
    rng = np.random.default_rng(0)
    q = rng.uniform(*cell.robot.sample_limits().T, (120, cell.robot.dof))
    found = doe.design(known, poses=4, candidates=poses_at(q))
    assert found.value >= found.bound * (1.0 - 1e-9)
    assert np.isfinite(found.assessment.std).all()
    told = [s for p, s in zip(found.problem.model.parameters, found.assessment.std, strict=True)
            if p.effect == "geometry"]  # fmt: skip
    assert (np.array(told) < 1.001 * std).all()
    # No plan of these candidates is better than the bound says, the best by their own look included.
    problem = found.problem
    blocks = problem.information(q)
    alone = problem.criterion.plain.value(problem.fixed + blocks)
    plans = [rng.choice(len(q), 4, replace=False) for _ in range(2000)]
    plans += [rng.choice(np.argsort(-alone)[:12], 4, replace=False) for _ in range(200)]
    M = problem.fixed + np.array([blocks[plan].sum(axis=0) for plan in plans])
    best = float(problem.criterion.plain.value(M).max())
    assert problem.criterion.shown(best) >= found.bound * (1.0 - 1e-6)
    assert problem.criterion.shown(best) >= found.value * (1.0 - 1e-6)
