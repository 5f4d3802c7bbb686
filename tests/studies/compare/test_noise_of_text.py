"""Noise as the text of a cell states it: by plain numbers, and against the package's weights."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.errors import InputError
from calib.noise import counted
from studies.compare.compare import PlanComparison, compare
from studies.compare.experiment import SimulatedExperiment, experiment_of
from studies.compare.stated_noise import stated_noise
from tests.helpers import with_effects
from tests.studies.command_line import paper_cell
from tests.studies.compare.fields import fields_of

HEAD = """
schema = 1
[robot]
urdf = "kr270.urdf"
base = "base_link"
tip = "tool0"
{robot}
[markers_mm]
m1 = [279.2, -16.4, -91.9]
m2 = [279.2, -25.2, 96.1]
[bodies.target]
position_mm = [280, 0, 0]
[model]
effects = ["base", "tool", "joint_offset:A2,A3"]
"""
CORRELATED = np.diag([4.0, 9.0, 16.0, 400.0, 900.0, 1600.0]) * 1e-4
CORRELATED[0, 4] = CORRELATED[4, 0] = 0.003
EVERY = f"""
[boards.plate]
on = "tip"
points_mm = {{ a = [0, 0, 0], b = [90, 0, 0], c = [0, 80, 0], d = [90, 80, 20] }}
[instruments.laser]
kind = "points"
sigma_mm = {{ range_mm = 0.003, transverse_mm = 0.004, transverse_mm_per_m = 0.0015 }}
position_mm = [4000, 0, 1500]
[instruments.probe]
kind = "pose"
sigma_mm = 0.02
sigma_urad = 60
[instruments.mocap]
kind = "pose"
covariance = {CORRELATED.tolist()}
[instruments.wall]
kind = "camera"
position_mm = [4000, 0, 1500]
rpy_deg = [-90, 0, 90]
focal_px = 2000
center_px = [1000, 800]
sigma_px = 0.2
[instruments.bar]
kind = "distance"
sigma_mm = 0.002
anchor_mm = [2000, 1500, 200]
"""


def written(folder: Path, instruments: str, robot: str = "") -> Path:
    paper_cell(folder)
    path = folder / "own.toml"
    path.write_text(HEAD.format(robot=robot) + instruments)
    return path


def experiment_at(path: Path, plan: Poses) -> SimulatedExperiment:
    cell = calib.load_cell(path)
    return experiment_of(cell, plan, stated=stated_noise(path, cell.instruments))


@pytest.mark.parametrize(
    ("sigma", "along", "across"),
    [
        ("0.01", 1e-5, 1e-5),
        ("{ range_mm = 0.003, transverse_mm = 0.004, transverse_mm_per_m = 0.0015 }", 3e-6, 7e-6),
        ("{ range_mm = 0.003, range_mm_per_m = 0.001, transverse_mm = 0.004 }", 5e-6, 4e-6),
        ("{ mpe_mm = 0.015, mpe_mm_per_m = 0.006, divisor = 2 }", 1.35e-5, 1.35e-5),
    ],
)
def test_a_point_two_metres_away(tmp_path: Path, sigma: str, along: float, across: float) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(f"[robot]\n[instrument]\nsigma_mm = {sigma}\nposition_mm = [1000, 0, 0]\n")
    stated = stated_noise(path)
    np.testing.assert_array_equal(stated.stands["instrument"], [1.0, 0.0, 0.0])
    start = np.array([[[1.0, 0.0, 0.0]]])
    white = np.random.default_rng(0).standard_normal((20_000, 1, 1, 3))
    exact = np.array([[[1.0, 2.0, 0.0]]])
    off = stated.of["instrument"].errors(white, exact, start)[:, 0, 0]
    np.testing.assert_allclose(off.std(axis=0), [across, along, across], rtol=0.03)
    assert np.abs(np.corrcoef(off.T) - np.eye(3)).max() < 0.05


def test_weights_of_every_instrument_whiten_what_its_text_states(
    tmp_path: Path, table_two: Poses
) -> None:
    experiment = experiment_at(written(tmp_path, EVERY), table_two)
    off = experiment.noise(400, np.random.default_rng(1))
    white = (experiment.weights @ off[..., None])[..., 0]
    numbers = counted(experiment.weights)
    for instrument, part in experiment.model.readout.channels.blocks:
        own = white[..., part, :]
        count = int(numbers[:, part].sum()) * 400
        low, high = chi2.ppf([1e-4, 1.0 - 1e-4], count)
        assert low < float((own**2).sum()) < high, instrument.name
        rows = own[..., own.any(axis=(0, 1, 2))].reshape(400 * len(experiment.poses), -1)
        rows = rows[:, rows.any(axis=0)]
        R = np.corrcoef(rows.T)
        assert np.abs(R - np.eye(len(R))).max() < 6.0 / np.sqrt(len(rows)), instrument.name


def test_the_cells_own_numbers_say_the_same(tmp_path: Path, table_two: Poses) -> None:
    path = written(tmp_path, EVERY, "repeatability_mm = 0.03\nrepeatability_urad = 100")
    by_text = experiment_at(path, table_two)
    by_cell = experiment_of(calib.load_cell(path), table_two)
    assert by_cell.stated.arm == by_text.stated.arm == pytest.approx((3e-5, 1e-4))
    drawn = [e.drawn(2, np.random.default_rng(0)) for e in (by_text, by_cell)]
    np.testing.assert_allclose(drawn[0], drawn[1], rtol=1e-12, atol=1e-15)


def test_the_arm_comes_elsewhere_at_each_visit(tmp_path: Path, table_two: Poses) -> None:
    """One rigid motion about the tip a visit, free and loaded, of the stated size, whoever reads."""
    laser = '[instruments.laser]\nkind = "points"\nsigma_mm = 1e-9\n'
    probe = '[instruments.probe]\nkind = "pose"\nsigma_mm = 1e-9\nsigma_urad = 1e-6\n'
    load = "[load]\nmass_kg = 10\ncom_mm = [0, 0, 0]\n"
    path = written(
        tmp_path, laser + probe + load, "repeatability_mm = 0.03\nrepeatability_urad = 100"
    )
    experiment = experiment_at(path, table_two)
    off = experiment.drawn(200, np.random.default_rng(3)) - experiment.readings()
    frames = experiment.model.state(experiment.truth, experiment.poses).frames
    away = experiment.readings()[:, :2, :3] - frames.o[:, -1:]
    turned = axes_turned(experiment, off)
    for marker in range(2):
        shift = off[:, :, marker, :3] - np.cross(turned, away[:, marker])
        assert spread(shift) == pytest.approx(3e-5, rel=0.05)
    np.testing.assert_allclose(turned[:, ::2], turned[:, 1::2], atol=1e-9)
    assert (np.abs(np.diff(turned[:, ::2], axis=1)).max(axis=(0, 2)) > 1e-5).all()
    assert spread(turned) == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_allclose(np.corrcoef(turned[:, 0].T), np.eye(3), atol=0.3)


def axes_turned(experiment: SimulatedExperiment, off: Array) -> Array:
    """Small rotation (trials, m, 3) of the body that the second instrument reads, in base axes."""
    exact = experiment.readings()[:, 2]
    x, y = exact[:, 3:6], exact[:, 6:]
    z = np.cross(x, y)
    moved = off[:, :, 2, 3:6], off[:, :, 2, 6:]
    by_x, by_y = -(moved[0] * z).sum(-1), (moved[0] * y).sum(-1)
    return ((moved[1] * z).sum(-1))[..., None] * x + by_x[..., None] * y + by_y[..., None] * z


def spread(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def few(cell: Cell, plan: Poses, **given: Any) -> PlanComparison:
    return compare(cell, {"p": plan}, trials=1, **given)


@pytest.mark.long
def test_without_mujoco_the_model_is_the_truth_and_it_is_said(
    kr270: Cell, table_two: Poses, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = with_effects(kr270, "base", "joint_compliance:A2")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    fields = fields_of(few(cell, table_two))
    assert fields["truth"] == "model"
    assert "MuJoCo is not installed" in fields["truth_note"]
    assert fields_of(few(cell, table_two, truth="model"))["truth_note"] == ""
    with pytest.raises(InputError, match="needs MuJoCo"):
        few(cell, table_two, truth="mujoco")


def test_what_mujoco_cannot_have_is_simulated_by_the_model(
    tmp_path: Path, kr270: Cell, table_two: Poses
) -> None:
    pytest.importorskip("mujoco")
    own = calib.load_cell(written(tmp_path, EVERY))
    for cell, why in (
        (
            with_effects(kr270, "joint_compliance:A2", "bearing_compliance:A2"),
            "bearing_compliance:A2",
        ),
        (own, "instrument probe (pose)"),
    ):
        fields = fields_of(few(cell, table_two))
        assert fields["truth"] == "model"
        assert fields["truth_note"] == f"{why} is nothing that MuJoCo's model of an arm has"
        with pytest.raises(InputError, match="leave out --truth mujoco"):
            few(cell, table_two, truth="mujoco")
