"""Days of many readings: what the benchmark draws, and what a run of it tells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.poses import poses_at
from studies.research.benchmarks.day import SIGMA, write_day
from studies.research.benchmarks.readings import KINDS, POSES, drawn, run

COUNT = 200


PLACES = {"own": 200, "still": 40, "approached": 40, "reference": 100}


@pytest.mark.parametrize(("kind", "places"), PLACES.items())
def test_readings_stand_as_they_are_called(kind: str, places: int) -> None:
    day = drawn(kind, COUNT)
    assert day.read.shape == (COUNT, 1, 3)
    assert len(np.unique(poses_at(day.q).configuration)) == places
    assert set(KINDS) == set(PLACES)


def test_readings_of_one_stay_differ_by_the_instrument_alone() -> None:
    day = drawn("still", 100 * POSES)
    apart = day.read.reshape(POSES, 100, 3).std(axis=1, ddof=1)
    np.testing.assert_allclose(np.sqrt((apart**2).mean()), SIGMA, rtol=0.05)


@pytest.mark.long
def test_a_run_tells_seconds_and_memory(tmp_path: Path) -> None:
    write_day(tmp_path, drawn("still", COUNT))
    found = run(["identify", "cell.toml", "measurements.csv"], tmp_path)
    assert not found["status"], found["said"]
    assert found["cpu"] > 0.0
    assert found["mb"] > 50.0
    missing = run(["identify", "cell.toml", "nothing.csv"], tmp_path)
    assert missing["status"] == 2
    assert "nothing.csv" in missing["said"][0]
