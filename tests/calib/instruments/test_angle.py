"""Theodolites: their places without a guess, tables, wraps of the circle, and what the commands say.

The truth is plain numpy: a chain and frames that share no code with the estimator.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.write_tables import measurements_csv
from calib.instruments import Angle
from tests.camera_cells import kr270_cell
from tests.plain_arm import rotation, tips
from tests.studies.command_line import run

OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])  # rad
HOME = np.radians([10.0, -60.0, 80.0, 15.0, 40.0, 20.0])
MARKERS = np.array([[0.12, -0.05, 0.2], [-0.1, 0.15, 0.1]])
STANDS = {"north": np.array([4.0, 1.5, 1.2]), "south": np.array([3.2, -3.0, 1.6])}
TURNS = {"north": np.array([0.02, -0.03, -2.9]), "south": np.array([-0.01, 0.02, 1.9])}
SIGMA = 2e-5  # rad


def written(folder: Path) -> calib.Cell:
    text = "[markers_mm]\n"
    for name, guess in zip(("m1", "m2"), 1e3 * MARKERS + 3.0, strict=True):
        text += f"{name} = {guess.tolist()}\n"
    for name in STANDS:
        text += f'[instruments.{name}]\nkind = "angle"\nsigma_urad = {1e6 * SIGMA}\n'
    effects = ("base", "tool", "joint_offset:A2,A3,A5")
    return calib.load_cell(kr270_cell(folder, text, effects=effects))


def angles(q: Array, robot: Robot, name: str) -> Array:
    """Azimuth and elevation (m, 2, 2), rad, of both markers."""
    T = tips(robot, q + OFF)
    points = np.einsum("mij,kj->mki", T[:, :3, :3], MARKERS) + T[:, None, :3, 3]
    own = (points - STANDS[name]) @ rotation(TURNS[name])
    level = np.sqrt(own[..., 0] ** 2 + own[..., 1] ** 2)
    return np.stack([np.arctan2(own[..., 1], own[..., 0]), np.arctan(own[..., 2] / level)], -1)


def table(folder: Path, cell: calib.Cell, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    q = HOME + rng.uniform(-0.6, 0.6, (30, 6))
    with (folder / "m.csv").open("w", newline="") as file:
        out = csv.writer(file)
        joints = [f"{joint}_deg" for joint in cell.robot.joints]
        out.writerow(["pose", "instrument", "marker", *joints, "azimuth_deg", "elevation_deg"])
        for name in STANDS:
            read = angles(q, cell.robot, name)
            read = np.degrees(read + rng.normal(scale=SIGMA, size=read.shape))
            read[..., 0] %= 360.0  # as a circle is numbered
            for i, k in np.ndindex(*read.shape[:2]):
                shown = [f"{x:.9f}" for x in (*np.degrees(q[i]), *read[i, k])]
                out.writerow([f"p{i:02d}", name, f"m{k + 1}", *shown])
    return folder / "m.csv"


def test_two_theodolites_find_the_joints(tmp_path: Path) -> None:
    """Offsets within their covariance, from rows alone; a table written is the table read."""
    cell, total = written(tmp_path), 0.0
    for seed in range(6):
        data = calib.load_measurements(cell, table(tmp_path, cell, seed))
        found = calib.identify(cell, data)
        own = [k for k, p in enumerate(found.model.parameters) if p.effect == "joint_offset"]
        off = found.values[own] - OFF[[1, 2, 4]]
        total += float(off @ np.linalg.solve(found.covariance[np.ix_(own, own)], off))
        assert found.noise.factor == pytest.approx(1.0, abs=0.2)
    assert 6.3 < total < 37.2  # chi-square with 18 degrees of freedom, 99.5 % each side
    (tmp_path / "again.csv").write_text(measurements_csv(cell, data))
    again = calib.load_measurements(cell, tmp_path / "again.csv")
    np.testing.assert_allclose(again.readings, data.readings, atol=1e-9)


def test_once_around_is_nothing() -> None:
    measured, predicted = np.array([[3.1, 0.2]]), np.array([[-3.1, 0.1]])
    off = Angle().difference(measured, predicted)
    np.testing.assert_allclose(off, [[6.2 - 2.0 * np.pi, 0.1]])


def test_commands_speak_of_milliradians(tmp_path: Path) -> None:
    cell = written(tmp_path)
    call = (tmp_path / "cell.toml", table(tmp_path, cell, 1), "--holdout", 0.3)
    for command in ("identify", "diagnose"):
        done = run(command, *call, "--json", tmp_path / command)
        assert done.exit_code == 0, done.output
    fields = json.loads((tmp_path / "identify").read_text())
    assert {(own["instrument"], own["unit"]) for own in fields["instruments"]} == {
        ("north", "mrad"),
        ("south", "mrad"),
    }
    assert set(fields["rms_mm"].values()) == {None}
    assert abs(fields["residuals"][0]["azimuth_mrad"]) < 1.0
    found = json.loads((tmp_path / "diagnose").read_text())
    assert (found["verdict"], found["gap"]["unit"]) == ("no_gap", "mrad")
    noise = 1e3 * SIGMA * np.sqrt(2.0)
    assert found["gap"]["heldout_before_mm"] == pytest.approx(noise, rel=0.4)
    assert found["gap"]["floor_mm"] == pytest.approx(noise, rel=1e-6)


def test_a_deviation_of_its_own(tmp_path: Path) -> None:
    cell = written(tmp_path)
    lines = table(tmp_path, cell, 1).read_text().splitlines()
    given = ["sigma_urad", "50", *[""] * (len(lines) - 2)]
    text = "\n".join(f"{line},{end}" for line, end in zip(lines, given, strict=True))
    (tmp_path / "own.csv").write_text(text + "\n")
    data = calib.load_measurements(cell, tmp_path / "own.csv")
    np.testing.assert_allclose(data.sigma[np.isfinite(data.sigma)], [5e-5])
