"""A fixed lens that is wrong is told from a wrong arm, beside what to free of it."""

from __future__ import annotations

from pathlib import Path

import pytest

import calib
from calib.identification.lenses import unfit_lenses
from studies.identify.parameters import UnfitLensEntry
from studies.research.benchmarks.lenses import written

pytest.importorskip("cv2", exc_type=ImportError)
pytestmark = pytest.mark.usefixtures("data")


@pytest.mark.parametrize(
    ("case", "wrong"),
    [
        ("E", True),
        *(pytest.param(c, True, marks=pytest.mark.long) for c in "ACFGL"),
        *(pytest.param(c, False, marks=pytest.mark.long) for c in "BDHIN"),
    ],
)
def test_a_wrong_lens_is_refused_and_nothing_else(tmp_path: Path, case: str, wrong: bool) -> None:
    path, table = written(tmp_path, case, 100)
    cell = calib.load_cell(path)
    found = calib.identify(cell, calib.load_measurements(cell, table))
    judged = list(unfit_lenses(found))
    assert bool(judged) is wrong
    if case == "E":
        (own,) = UnfitLensEntry.from_each(judged)
        assert own.free == ("focal", "center", "distortion")
        assert own.rms_px > 1.5 * own.with_it_free_px > 0.1
        assert "The readings do not fit the lens of camera: 0." in own.said
        assert len(own.said.split()) <= 30


@pytest.mark.long
def test_a_free_lens_is_never_refused(tmp_path: Path) -> None:
    path, table = written(tmp_path, "A", 100)
    free = 'sigma_px = 0.1\nfree = ["focal", "center", "distortion"]'
    path.write_text(path.read_text().replace("sigma_px = 0.1", free))
    cell = calib.load_cell(path)
    found = calib.identify(cell, calib.load_measurements(cell, table))
    assert not list(unfit_lenses(found))
    assert found.by_instrument["camera", "px"]["fitted"] < 0.15
