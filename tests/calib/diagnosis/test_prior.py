"""What a cell states as common to all readings is no cause, what is far larger is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from tests.calib.prediction import common_days as days

STATED = 6.0  # um/m
SCALE = f"[instrument.common]\nscale_um_m = {STATED}\n"


def diagnosed(folder: Path, common: str, scale: float) -> calib.Diagnosis:
    """A day on which the tracker's metre is longer by so many um, and nothing else is wrong."""
    rng = np.random.default_rng(1)
    q = days.joints(24, rng)
    day = {name: np.zeros(count) for name, count in days.COMPONENTS.items()}
    day["scale"] = np.array([scale * 1e-6])
    table = days.table(q, days.read(days.points(days.TRUE, q), day, rng))
    (folder / "data.csv").write_text(table)
    cell = calib.load_cell(days.write_cell(folder, common))
    return calib.diagnose(cell, calib.load_measurements(cell, folder / "data.csv"))


@pytest.mark.parametrize(("common", "alarm"), [("", True), (SCALE, False)])
def test_what_lies_within_the_statement_is_no_cause(
    tmp_path: Path, common: str, alarm: bool
) -> None:
    found = diagnosed(tmp_path, common, 2.0 * STATED)
    assert (found.verdict != "no_gap") == alarm
    assert bool(found.causes) == alarm


def test_what_is_far_beyond_it_is_named(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, SCALE, 10.0 * STATED)
    assert [c.named.candidate.key for c in found.causes] == ["tracker_scale:instrument"]
    cause = found.causes[0]
    assert cause.values[0] == pytest.approx(10.0 * STATED * 1e-6, abs=3.0 * cause.std[0])
    # How much of it is what was stated nobody knows.
    assert cause.std[0] > 0.9 * STATED * 1e-6
