"""What could hide leaves at the targets what is said: against an arm of MuJoCo that has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from calib.arrays import Array
from calib.diagnosis import Diagnosis
from calib.diagnosis.detection_limit import DetectionLimit
from studies.research.truth.day import Day, Setting, draw_day, write_day

SETTING = Setting("6R", scatter=0.0, approaches=1, poses=30, markers=2)


def day_of(folder: Path, scale: float, joint: int) -> tuple[calib.Cell, Day]:
    """Read exactly, with a joint that turns by so much more than it says."""
    day = draw_day(SETTING, 1, 0, lambda q: q * (1.0 + scale * (np.arange(q.shape[1]) == joint)))
    folder.mkdir()
    write_day(folder, day)
    return calib.load_cell(folder / "cell.toml"), day


def of(found: Diagnosis, kind: str, where: str) -> DetectionLimit:
    (own,) = (h for h in found.hidden if (h.effect, h.where) == (kind, where))
    return own


@pytest.mark.long
def test_what_hides_leaves_what_is_said(tmp_path: Path) -> None:
    cell, day = day_of(tmp_path / "without", 0.0, 0)
    found = calib.diagnose(
        cell, calib.load_measurements(cell, tmp_path / "without/measurements.csv")
    )
    assert found.verdict == "no_gap"
    assert all(np.isfinite(h.left) and h.left >= 0.0 for h in found.hidden)
    for joint in (1, 4):
        hidden = of(found, "transmission_scale", cell.robot.joints[joint])
        cell, day = day_of(tmp_path / str(joint), hidden.smallest, joint)
        data = calib.load_measurements(cell, tmp_path / str(joint) / "exact.csv")
        targets, _ = calib.load_targets(cell, tmp_path / str(joint) / "targets.csv")
        without = calib.identify(cell, data)
        assert rms(without.predict(targets) - day.reached) == pytest.approx(hidden.left, rel=0.05)


def rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
