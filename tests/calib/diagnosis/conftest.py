"""Days in MuJoCo that several tests diagnose, and what is found of them."""

from __future__ import annotations

import pytest

import calib
from calib import Diagnosis
from tests.calib.diagnosis.days import Day, lost_motion, measured_day, settling


@pytest.fixture(scope="session")
def settling_day(tmp_path_factory: pytest.TempPathFactory) -> Day:
    """The elbow is read before it was at rest."""
    return measured_day(tmp_path_factory.mktemp("settling"), settling("elbow"), 600.0, 1)


@pytest.fixture(scope="session")
def lost_motion_day(tmp_path_factory: pytest.TempPathFactory) -> Day:
    """The elbow has backlash."""
    return measured_day(tmp_path_factory.mktemp("lost_motion"), lost_motion("elbow"), 600.0, 1)


@pytest.fixture(scope="session")
def found_lost_motion(lost_motion_day: Day) -> Diagnosis:
    cell, data, heldout = lost_motion_day
    return calib.diagnose(cell, data, heldout=heldout)
