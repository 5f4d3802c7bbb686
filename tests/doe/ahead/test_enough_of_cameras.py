"""Nothing systematic, and no drift, is seen on days of cameras where none is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

import calib
import doe
from calib.compensation.estimate import fitted_of
from calib.compensation.trend import trend_of
from tests.camera_days import SETUPS, Truth, kr270_day

OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])


@pytest.mark.parametrize(
    ("setup", "grows", "scatter", "seeds"),
    [
        # A camera quieter than stated, a tracker as stated.
        pytest.param("kr270", False, 0.0, (0, 4, 7), marks=pytest.mark.part),
        pytest.param("kr270", True, 1.5e-5, (9, 14), marks=pytest.mark.part),
        pytest.param("kr270", False, 0.0, range(20), marks=pytest.mark.long),
        pytest.param("kr270", True, 1.5e-5, range(20), marks=pytest.mark.long),
        pytest.param("kr270, two", False, 0.0, range(20), marks=pytest.mark.long),
    ],
)
def test_clean_days_have_nothing_systematic(
    tmp_path: Path, setup: str, grows: bool, scatter: float, seeds: range
) -> None:
    """On one day in twenty chance looks like something: counted 2 of 60 for two cameras."""
    systematic = 0
    for seed in seeds:
        truth = Truth(OFF, seed=seed, grows=grows, scatter=scatter)
        cell, data = kr270_day(tmp_path, SETUPS[setup], truth, 30, 4)
        found = doe.enough(cell, data)
        lacking, now = found.lacking, found.steps[0].task_rms
        systematic += bool(lacking.surely and lacking.of_model > 0.5 * now)
        assert not lacking.trend
    assert systematic <= len(seeds) // 10


def test_a_drift_is_seen_in_the_order_of_the_stays(tmp_path: Path) -> None:
    """A tracker's station that creeps by 2 um a reading; in any other order it is none."""
    cell, data = kr270_day(tmp_path, SETUPS["kr270"], Truth(OFF, scatter=1.5e-5), 30, 4)
    moved = data.readings.copy()
    trackers = np.flatnonzero(np.isfinite(data.readings[0, :, 2]) & (data.readings[0, :, 2] != 0))
    moved[:, trackers, 0] += 3e-6 * np.arange(len(data))[:, None]
    drifted = type(data)(data.poses, moved, data.seen, data.sigma)
    assert trend_of(fitted_of(calib.identify(cell, drifted))) is not None
    assert trend_of(fitted_of(calib.identify(cell, data))) is None
