"""The next poses in the result, against those that were chosen."""

from __future__ import annotations

import json

import numpy as np
import pytest

import doe
from calib import Cell
from calib.diagnosis import Diagnosis
from doe.ahead.likeness import SURE
from studies.diagnose.make import diagnose_record
from studies.record import envelope
from tests.doe.ahead.test_next_poses import alike

__all__ = ["alike"]  # a fixture


def test_fields_are_those_of_the_contract(alike: tuple[Cell, Diagnosis]) -> None:
    cell, found = alike
    result = doe.next_poses(cell, found, count=5)
    record = diagnose_record(found, (), result, None, None, envelope("cell", []))
    fields = json.loads(record.dumps(), parse_constant=pytest.fail)
    pair = [c.key for c, _ in found.causes[0].named.members]
    assert len(fields["next_poses"]) == 5
    for pose, q in zip(fields["next_poses"], result.poses.q, strict=True):
        np.testing.assert_allclose(
            [pose["joints_deg"][joint] for joint in cell.robot.joints], np.degrees(q), atol=1e-5
        )
    assert any(pose["splits"] == [pair] for pose in fields["next_poses"])
    (predicted,) = fields["next_poses_predicted"]
    assert predicted["rivals"] == pair
    assert predicted["probability_now"] < SURE <= predicted["probability_after"]
    assert predicted["inseparable"] is False
