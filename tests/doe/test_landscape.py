"""Directional derivatives of a design, candidate by candidate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import doe
from calib import Cell
from calib.cell.planned import Planned
from doe.problem import problem_of
from doe.problem.request import Request
from doe.problem.visits import Visits

ELASTIC = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
LEVELS = "A2=-140,-99.85,-56.9,-25.24,-0.01x3"


@pytest.fixture(scope="module", params=["D", "A", "task"])
def plan(kr270: Cell, request: pytest.FixtureRequest) -> doe.Design:
    cell = replace(kr270, effects=ELASTIC, design=Planned())
    return doe.design(cell, levels=LEVELS, criterion=request.param, candidates=1500, refine=False)


@pytest.mark.long
def test_chosen_candidates_are_the_plan(plan: doe.Design) -> None:
    view = plan.landscape
    assert view.chosen.sum() == len(plan.poses)
    np.testing.assert_allclose(
        np.sort(view.q[view.chosen], axis=0), np.sort(plan.poses.q, axis=0), atol=1e-12
    )
    assert len(view.q) == plan.candidates.feasible


@pytest.mark.long
def test_three_candidates_of_a_level_reach_it(plan: doe.Design) -> None:
    """The share is one at the candidate that is just good enough for its level."""
    view = plan.landscape
    for level in np.unique(view.q[:, 1]):
        share = np.sort(view.share[view.q[:, 1] == level])[::-1]
        assert share[2] == pytest.approx(1.0)
        assert share[3] <= 1.0 + 1e-12


def test_share_is_the_derivative_of_the_criterion(kr270: Cell) -> None:
    """Ratios of shares within a level against finite differences of log det at the weighted plan."""
    cell = replace(kr270, effects=ELASTIC, design=Planned())
    plan = doe.design(cell, poses=12, criterion="D", candidates=400, refine=False, repeats=True)
    problem = problem_of(cell, Request(poses=12, criterion="D", repeats=True))
    view = plan.landscape
    M = problem.fixed + problem.information(Visits(plan.poses.q)).sum(axis=0)
    blocks = problem.information(Visits(view.q))

    def log_det(A: np.ndarray) -> float:
        return float(np.linalg.slogdet(A)[1])

    gain = np.array([(log_det(M + 1e-6 * B) - log_det(M)) / 1e-6 for B in blocks])
    # The whole plan stands close to the weighted one at which the bound was found.
    assert np.corrcoef(gain, view.share)[0, 1] > 0.97
