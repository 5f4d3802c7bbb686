"""Rows copied bit for bit, an instrument that stuck, and honest repeats, which are neither."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Measurements
from calib.arrays import Array
from tests.calib.arm_days import Day, day

GOOD = day(seed=30, poses=30)


def read(of: Day, folder: Path, digits: int = 9) -> Measurements:
    """The table as read, its points shown with so many digits of a millimetre."""
    cell, _ = of.with_points(lambda p: np.round(p * 1e3, digits) / 1e3).read(folder)
    return calib.load_measurements(cell, folder / "measurements.csv")


def again(of: Day, poses: Array, noise: float = 0.0) -> Day:
    """Some poses once more at the end, read with fresh noise [m]."""
    new = of.points[poses] + np.random.default_rng(1).normal(size=of.points[poses].shape) * noise
    return replace(
        of, q=np.concatenate([of.q, of.q[poses]]), points=np.concatenate([of.points, new])
    )


@pytest.mark.parametrize("count", [1, 20])
def test_copies_are_left_out_and_said(count: int, tmp_path: Path) -> None:
    data = read(again(GOOD, np.arange(count)), tmp_path)
    assert data.poses.names == tuple(f"p{i:03d}" for i in range(30))
    (said,) = [text for text in data.warnings if "last digit" in text]
    assert "p000 and p030" in said
    assert "left out" in said
    good = read(GOOD, tmp_path)
    np.testing.assert_array_equal(data.points, good.points)
    np.testing.assert_array_equal(data.poses.q, good.poses.q)


@pytest.mark.parametrize("digits", [9, 4])
def test_readings_of_a_second_approach_are_kept(digits: int, tmp_path: Path) -> None:
    data = read(again(GOOD, np.arange(20), 2e-5), tmp_path, digits)
    assert len(data) == 50
    assert not data.warnings


def test_copies_beside_second_approaches_are_found(tmp_path: Path) -> None:
    mixed = again(again(GOOD, np.arange(10), 2e-5), np.arange(20, 30))
    assert read(mixed, tmp_path).poses.names == tuple(f"p{i:03d}" for i in range(40))


def test_digits_no_finer_than_the_noise_repeat_by_chance(tmp_path: Path) -> None:
    """A display of 0.1 mm: the second visit reads the same, and nobody copied."""
    data = read(again(GOOD, np.arange(20), 1e-6), tmp_path, 1)
    assert len(data) == 50
    assert not data.warnings


def test_an_instrument_that_stuck_is_named_and_kept(tmp_path: Path) -> None:
    def stuck(points: Array) -> Array:
        points = points.copy()
        points[6] = points[5]
        return points

    data = read(GOOD.with_points(stuck), tmp_path)
    assert len(data) == 30
    (said,) = data.warnings
    assert "the points of p005 and p006 are equal to the last digit, but the joints are not" in said
    assert "measure these poses again" in said


def test_a_load_hung_on_is_no_copy(tmp_path: Path) -> None:
    """Equal joints and points under another wrench are another reading, as exact data have it."""
    folder = again(GOOD, np.arange(20)).written(tmp_path)
    head, *rows = (folder / "measurements.csv").read_text().strip().split("\n")
    loads = [f"{row},0,0,{-500 if i >= 90 else 0},0,0,0" for i, row in enumerate(rows)]
    columns = f"{head},fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm"
    (folder / "measurements.csv").write_text("\n".join([columns, *loads, ""]))
    cell = calib.load_cell(folder / "cell.toml")
    assert len(calib.load_measurements(cell, folder / "measurements.csv")) == 50


def test_real_readings_that_stuck_are_found(data: Path) -> None:
    """Two of 1495 of a UR10: the joints moved by 136 and 83 deg, nine numbers did not."""
    cell = calib.load_cell(data / "ur10_leica_b" / "cell.toml")
    read_ = calib.load_measurements(cell, data / "ur10_leica_b" / "measurements.csv")
    said = " ".join(read_.warnings)
    assert "p00531 and p00532, p01062 and p01063 are equal to the last digit" in said
    assert len(read_) == 1495


def test_real_repeats_on_a_coarse_display_are_kept(data: Path) -> None:
    """A Meca500 read to 0.001 mm: nine of 186 repeats are equal by chance."""
    cell = calib.load_cell(data / "meca500_right80" / "cell.toml")
    read_ = calib.load_measurements(cell, data / "meca500_right80" / "measurements.csv")
    assert len(read_) == 279
    assert not any("last digit" in text for text in read_.warnings)
