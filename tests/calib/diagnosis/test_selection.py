"""A selection lowers one objective, and where it stops no member is better left out."""

from __future__ import annotations

import numpy as np
import pytest

from calib import Diagnosis
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.selection import lower_states, selection, start
from calib.diagnosis.state import SelectionState


@pytest.fixture(scope="module")
def problem(found_lost_motion: Diagnosis) -> RegressionProblem:
    """Of the day on which the elbow has backlash, at the fit without candidates."""
    outcome = found_lost_motion.outcome
    asked = outcome.state.problem.candidates
    return RegressionProblem.of(found_lost_motion.stage, asked, outcome.before.span)


@pytest.fixture(scope="module")
def passes(problem: RegressionProblem) -> list[SelectionState]:
    """The states that a selection goes through."""
    states = [start(problem, ())]
    for _ in range(20):
        better = next(lower_states(states[-1].scanned()), None)
        if better is None:
            break
        states.append(better)
    return states


def test_the_objective_falls_and_the_cause_is_in(passes: list[SelectionState]) -> None:
    objectives = [state.objective for state in passes]
    assert len(objectives) > 1
    assert (np.diff(objectives) < 0.0).all()
    assert "backlash:elbow" in {m.key for m in passes[-1].members}


def test_no_member_is_better_left_out(passes: list[SelectionState]) -> None:
    last = passes[-1]
    for member in last.members:
        rest = tuple(m for m in last.members if m is not member)
        assert last.with_members(rest).objective > last.objective


def test_a_selection_that_goes_on_ends_where_it_was(
    problem: RegressionProblem, passes: list[SelectionState]
) -> None:
    found = passes[-1].active
    again = selection(problem, found).active
    assert {c.key for c in again} == {c.key for c in found}
