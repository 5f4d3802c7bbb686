"""Noise that grows with range: its law, its share of the cases, and what the cell says of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from studies.research.withheld.draw import draw_case
from studies.research.withheld.keys import key_of, write_case
from studies.research.withheld.scene import MIDDLE, Noise
from tests.studies.research.withheld.scenes import PLAIN

LAW = Noise(along=5e-6, across=4e-6, across_per_m=3e-6)


def covariance(noise: Noise, point: np.ndarray) -> np.ndarray:
    """By its definition, written out."""
    away = float(np.linalg.norm(point))
    beam = np.outer(point, point) / away**2
    across = noise.across + noise.across_per_m * away
    return noise.along**2 * beam + across**2 * (np.eye(3) - beam)


def test_drawn_noise_has_its_covariance() -> None:
    rng, point = np.random.default_rng(0), np.array([1.0, -3.0, 2.0])
    drawn = LAW.coloured(rng.normal(size=(200_000, 3)), np.tile(point, (200_000, 1)))
    expected = covariance(LAW, point)
    np.testing.assert_allclose(np.cov(drawn.T), expected, atol=0.01 * np.abs(expected).max())
    back = LAW.whitened(drawn, np.tile(point, (200_000, 1)))
    np.testing.assert_allclose(np.cov(back.T), np.eye(3), atol=0.01)


def test_floor_is_the_root_of_the_traces() -> None:
    points = np.random.default_rng(1).normal(size=(30, 2, 3)) * 3.0
    seen = np.random.default_rng(2).random((30, 2)) > 0.2
    traces = [np.trace(covariance(LAW, p)) for p in points[seen]]
    assert LAW.rms(points, seen) == pytest.approx(np.sqrt(np.mean(traces)))
    alike = Noise.uniform(2e-5)
    assert alike.rms(points, seen) == pytest.approx(np.sqrt(3.0) * 2e-5)
    assert LAW.sigma == pytest.approx(
        LAW.rms(np.array([[MIDDLE, 0.0, 0.0]]), np.array([True])) / 3**0.5
    )


@pytest.mark.parametrize("word", ["said", "unsaid"])
def test_cell_says_it_or_not(word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the program under test whitens by: the true law where it is said, else one sigma."""
    plain = replace(PLAIN, known_geometry=False, configurations=45, range_noise=word)
    monkeypatch.setattr("studies.research.withheld.draw._conditions", lambda rng: plain)
    case = draw_case(np.random.default_rng(5), "null")
    write_case(tmp_path / "case", case)
    cell = calib.load_cell(tmp_path / "case" / "cell.toml")
    truth = case.scene.noise
    assert truth.grows
    said = (cell.noise.along, cell.noise.across, cell.noise.across_per_m)
    if word == "said":
        assert said == pytest.approx((truth.along, truth.across, truth.across_per_m), abs=1e-12)
    else:
        assert said == (case.scene.arm.sigma, case.scene.arm.sigma, 0.0)
    key = key_of(case, "case", 0, "salt")
    assert key["heldout_noise_rms_mm"] == pytest.approx(key["floor_mm"], rel=0.15)
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    found = calib.identify(cell, data)
    if word == "said":
        assert found.noise.lack_of_fit_p > 0.01
