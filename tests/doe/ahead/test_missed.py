"""What lies near poses that could not be read is left out."""

from __future__ import annotations

import numpy as np

from calib.poses import poses_at
from doe.ahead.situation import likely_read, refusal
from studies.demo.embedded import embedded_cell


def test_the_nearest_pose_that_was_tried_decides() -> None:
    robot, rng = embedded_cell().robot, np.random.default_rng(0)
    low, high = robot.sample_limits().T
    q, read, missed = (rng.uniform(low, high, (n, len(low))) for n in (300, 7, 4))
    kept = likely_read(robot, q, poses_at(read), poses_at(missed))
    for one, own in zip(q, kept, strict=True):
        tried = [(float(np.linalg.norm((one - r) / (high - low))), True) for r in read]
        tried += [(float(np.linalg.norm((one - m) / (high - low))), False) for m in missed]
        assert own == min(tried)[1]
    assert 0 < kept.sum() < len(q)
    assert likely_read(robot, q, poses_at(read), None).all()
    assert not likely_read(robot, missed, poses_at(read), poses_at(missed)).any()


def test_the_refusal_says_whose_fault_it_is() -> None:
    assert "missed by accident" in refusal(poses_at(np.zeros((2, 6))))
    assert "relax [design]" in refusal(None)
