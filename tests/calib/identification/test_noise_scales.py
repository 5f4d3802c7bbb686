"""Of several instruments each has its own noise, and what one has too much is not the other's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

import calib
from calib import Cell, Measurements
from tests.camera_days import SETUPS, SIGMA_M, Truth, kr270_day
from tests.studies.command_line import run

OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])


def day(folder: Path, setup: str, truth: Truth, **more: str) -> tuple[Cell, Measurements]:
    return kr270_day(folder, SETUPS[setup], truth, 26, 4, **more)


@pytest.mark.parametrize(
    ("setup", "scales"),
    [
        ("kr270", {}),
        ("kr270", {"cam": 2.0}),
        ("kr270", {"cam": 0.5, "tracker": 2.0}),
        pytest.param("kr270, two", {"left": 2.0}, marks=pytest.mark.long),
        pytest.param("kr270", {"tracker": 2.0}, marks=pytest.mark.long),
        ("kr270, hand", {"cam": 2.0}),
    ],
)
@pytest.mark.parametrize("scatter", [0.0, 2e-5])
def test_each_has_its_own(
    tmp_path: Path, setup: str, scales: dict[str, float], scatter: float
) -> None:
    cell, data = day(tmp_path, setup, Truth(OFF, seed=3, scales=scales, scatter=scatter))
    found = calib.identify(cell, data)
    if len(cell.instruments) == 1:  # its noise has a level of its own
        assert not found.model.noise_scales
        assert found.noise.sigma / found.noise.stated == pytest.approx(2.0, rel=0.1)
        return
    assert found.model.noise_scales == {
        name: pytest.approx(times, rel=0.1) for name, times in scales.items()
    }
    assert found.noise.factor == pytest.approx(1.0, abs=0.02)


def test_a_model_that_lacks_something_makes_no_instrument_noisy(tmp_path: Path) -> None:
    """What the arm does moves all that rides on its tip as one."""
    cell, data = day(tmp_path, "kr270", Truth(OFF, scales={"cam": 2.0}), effects='"base", "tool"')
    found = calib.identify(cell, data)
    assert found.rms("fitted") > 10.0 * SIGMA_M
    assert found.model.noise_scales == {"cam": pytest.approx(2.0, rel=0.1)}


@pytest.mark.long
def test_what_is_off_is_off_by_its_deviation(tmp_path: Path) -> None:
    """Beside a camera twice as noisy as stated: 16 days, three offsets each."""
    squares = []
    for seed in range(16):
        truth = Truth(OFF, seed=seed, scales={"cam": 2.0, "tracker": 0.7}, moved=(0.0, 0.0))
        cell, data = day(
            tmp_path, "kr270", truth, effects='"base", "tool", "joint_offset:A2,A3,A5"'
        )
        found = calib.identify(cell, data)
        at = [i for i, p in enumerate(found.model.parameters) if p.effect == "joint_offset"]
        missed = found.values[at] - OFF[[1, 2, 4]]
        cov = found.covariance[np.ix_(at, at)]
        squares.append(float(missed @ np.linalg.solve(cov, missed)))
    assert 29.0 < sum(squares) < 72.0, "a chi-square of 48, 19 times in 20"


def test_it_is_told(tmp_path: Path) -> None:
    day(tmp_path, "kr270", Truth(OFF, scales={"cam": 2.0}))
    said = run("identify", tmp_path / "cell.toml", tmp_path / "measurements.csv").output
    assert "Noise of cam: 2.0 times as stated" in said
    assert "0.0200 mm in each coordinate, as the cell states" in said
    assert "noise of tracker" not in said


@pytest.mark.long
def test_the_diagnosis_weighs_by_it(tmp_path: Path) -> None:
    cell, data = day(tmp_path, "kr270", Truth(OFF, seed=2, scales={"cam": 2.0}))
    found = calib.diagnose(cell, data)
    assert found.after.model.noise_scales["cam"] == pytest.approx(2.0, rel=0.1)
    assert (found.verdict, found.rest.kind, found.causes) == ("no_gap", "none", ())
    assert found.noise.sigma == pytest.approx(SIGMA_M, rel=0.05)
