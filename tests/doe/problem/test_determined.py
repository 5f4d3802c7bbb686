"""What the arm's own weight does not show is left out of a plan and said; what is wanted is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
import doe
from calib import load_cell
from calib.cell import Cell
from calib.model.build import build
from calib.simulation import drawn_readings
from doe.request import CannotIdentify
from tests import two_arms
from tests.doe.plans import unpolished, visiting_again

HIP = "joint_compliance:hip.compliance"
MARKERS = (
    '[markers_mm]\nright = [30, 40, -50]\nleft = { position = [40, -30, -60], on = "left_hand" }\n'
    "[instrument]\nsigma_mm = 0.02\n"
)


@pytest.fixture(scope="module")
def elastic(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """Two arms on a torso whose first axis is vertical, both hands read by one tracker."""
    folder = tmp_path_factory.mktemp("pair")
    effects = '"base", "tool", "joint_offset", "joint_compliance"'
    return load_cell(two_arms.written(folder, MARKERS, effects=effects))


def plan(cell: Cell) -> doe.Design:
    return unpolished(visiting_again(cell, 0), poses=16, candidates=300)


def test_what_no_weight_turns_is_left_out_of_the_plan_and_of_the_fit(elastic: Cell) -> None:
    found = plan(elastic)
    left = [name for entry in found.problem.left_out for name in entry.names]
    assert HIP in left
    assert "joint_compliance:bend.compliance" not in left
    assert not set(left) & {p.id for p in found.problem.model.parameters}
    assert any(HIP in note and "no reading changes with it" in note for note in found.notes)
    model = build(elastic, found.poses).model
    truth = np.array([p.size for p in model.parameters]) * 0.1
    data = drawn_readings(model, truth, found.poses, None, np.random.default_rng(0))
    lost = calib.identify(elastic, data).choice.unidentifiable
    assert {name for entry in lost for name in entry.names} == set(left)


def test_what_is_named_with_its_place_is_refused(elastic: Cell) -> None:
    wanted = ("base", "tool", "joint_offset", "joint_compliance:hip,bend,right2,left2")
    with pytest.raises(CannotIdentify, match=HIP):
        plan(replace(elastic, effects=wanted))


def test_bearings_of_both_arms_are_planned_for(elastic: Cell) -> None:
    """Their plausible size is a bearing's: two kilograms a link show tilts of the torso."""
    found = plan(replace(elastic, effects=(*elastic.effects, "bearing_compliance")))
    planned = {p.id for p in found.problem.model.parameters}
    assert {"bearing_compliance:hip.tilt", "bearing_compliance:right2.tilt"} <= planned
