"""Experiments with an arm that comes to a pose otherwise each time: predicted, simulated, refitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import calib
from calib import Cell, Measurements, Poses
from calib.api import in_turn
from calib.arrays import Array
from calib.cell import Repeatability
from calib.cell.planned import Planned
from calib.model.build import build
from calib.poses import poses_at
from studies.compare.experiment import POINTS, experiment_of, predict
from studies.compare.simulate import agreement
from studies.results.compare import compared
from tests.helpers import with_effects
from tests.studies.command_line import paper_cell

ARM = Repeatability(3e-5, 1e-4)
EFFECTS = ("base", "tool", "joint_offset", "joint_compliance:A2,A3")


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *EFFECTS), repeatability=ARM, design=Planned())


@pytest.fixture(scope="module")
def plan(table_two: Poses) -> Poses:
    """Table II, and three of its poses once more."""
    return poses_at(np.concatenate([table_two.q, table_two.q[[1, 5, 9]]]))


@pytest.mark.long
def test_refits_scatter_as_predicted(cell: Cell, plan: Poses) -> None:
    """Both approaches in every weighting, free and loaded in one visit, poses visited again."""
    (found,) = compared(cell, {"plan": plan}, 160, seed=2)
    assert len(found.approaches) == 4
    for own in found.approaches:
        assert own.agreement is not None
        assert own.agreement.chi2_p is not None
        assert own.agreement.chi2_p > 1e-3
        assert own.monte_carlo_task_rms_mm == pytest.approx(own.task_rms_mm, rel=0.12)
    (blind,) = compared(replace(cell, repeatability=None), {"plan": plan})
    assert found.points.task_rms_mm is not None
    assert blind.points.task_rms_mm is not None
    assert found.points.task_rms_mm > 2.0 * blind.points.task_rms_mm


def test_a_prediction_that_forgets_the_arm_is_refuted(cell: Cell, plan: Poses) -> None:
    """Errors of the right size for an arm that scatters, judged by a cell whose arm does not."""
    experiment = experiment_of(cell, plan)
    forgetful = replace(experiment, arm=None)
    prediction = predict(forgetful, experiment.ways[-1])
    right = predict(experiment, experiment.ways[-1])
    rng = np.random.default_rng(0)
    errors = rng.multivariate_normal(np.zeros(len(right.covariance)), right.covariance, 200)
    judged = agreement(errors, prediction.covariance)
    assert judged is not None
    assert judged.p < 1e-6


def displaced(
    cell: Cell, poses: Poses, values: Array, visit: Array, rng: np.random.Generator
) -> Measurements:
    """Readings of a tip that is shifted and turned anew at each visit, by scipy's rotations."""
    model = build(cell, poses).model
    state = model.state(values, poses)
    o = model.readings(values, poses, state.frames.o[:, -1:])
    shift = rng.normal(size=(visit.max() + 1, 1, 3)) * ARM.translation
    turn = Rotation.from_rotvec(rng.normal(size=(visit.max() + 1, 3)) * ARM.rotation).as_matrix()
    points = model.predict(values, poses) - o
    points = points @ np.swapaxes(turn, -1, -2)[visit] + shift[visit] + o
    points = points + rng.normal(size=points.shape) * cell.noise.along
    return Measurements(
        poses, points, np.ones(points.shape[:2], bool), np.full(points.shape[:2], np.nan)
    )


@pytest.mark.long
def test_identify_reaches_what_was_promised(cell: Cell, plan: Poses) -> None:
    """Days of measurement by a simulation of their own, identified as real data are."""
    poses = in_turn(cell, plan)
    visit = np.arange(len(poses)) // 2
    experiment = experiment_of(cell, plan, seed=1)
    prediction = predict(replace(experiment, nominal=experiment.truth), POINTS)
    inverse = np.linalg.pinv(
        prediction.covariance / np.outer(prediction.std, prediction.std), hermitian=True
    )
    squares, days, more = 0.0, 24, 0
    rng = np.random.default_rng(7)
    for _ in range(days):
        data = displaced(cell, poses, experiment.truth, visit, rng)
        found = calib.identify(cell, data)
        assert found.levels is not None
        if found.levels.estimated:  # by chance something seems to scatter beside the arm
            more += 1
        else:
            np.testing.assert_allclose(found.std, prediction.std, rtol=0.02)
        off = (found.values - experiment.truth) / prediction.std
        squares += off @ inverse @ off
    assert more <= 2
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], days * len(prediction.std))
    assert low < squares < high


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


def written(folder: Path, instruments: str, robot: str = "") -> Path:
    paper_cell(folder)
    path = folder / "own.toml"
    path.write_text(HEAD.format(robot=robot) + instruments)
    return path


def test_the_arm_comes_elsewhere_at_each_visit(tmp_path: Path, table_two: Poses) -> None:
    """One rigid motion about the tip a visit, free and loaded, of the stated size, whoever reads."""
    laser = '[instruments.laser]\nkind = "points"\nsigma_mm = 1e-9\n'
    probe = '[instruments.probe]\nkind = "pose"\nsigma_mm = 1e-9\nsigma_urad = 1e-6\n'
    load = "[load]\nmass_kg = 10\ncom_mm = [0, 0, 0]\n"
    path = written(
        tmp_path, laser + probe + load, "repeatability_mm = 0.03\nrepeatability_urad = 100"
    )
    experiment = experiment_of(calib.load_cell(path), table_two)
    exact = experiment.model.predict(experiment.truth, experiment.poses)
    off = experiment.drawn(200, np.random.default_rng(3)) - exact
    frames = experiment.model.state(experiment.truth, experiment.poses).frames
    away = exact[:, :2, :3] - frames.o[:, -1:]
    turned = axes_turned(exact, off)
    for marker in range(2):
        shift = off[:, :, marker, :3] - np.cross(turned, away[:, marker])
        assert spread(shift) == pytest.approx(3e-5, rel=0.05)
    np.testing.assert_allclose(turned[:, ::2], turned[:, 1::2], atol=1e-9)
    assert (np.abs(np.diff(turned[:, ::2], axis=1)).max(axis=(0, 2)) > 1e-5).all()
    assert spread(turned) == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_allclose(np.corrcoef(turned[:, 0].T), np.eye(3), atol=0.3)


def axes_turned(exact: Array, off: Array) -> Array:
    """Small rotation (trials, m, 3) of the body that the second instrument reads, in base axes."""
    x, y = exact[:, 2, 3:6], exact[:, 2, 6:]
    z = np.cross(x, y)
    moved = off[:, :, 2, 3:6], off[:, :, 2, 6:]
    by_x, by_y = -(moved[0] * z).sum(-1), (moved[0] * y).sum(-1)
    return ((moved[1] * z).sum(-1))[..., None] * x + by_x[..., None] * y + by_y[..., None] * z


def spread(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))
