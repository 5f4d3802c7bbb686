"""The budget against days that are simulated by other code, and against a sheet worked by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.identification import Identification
from calib.inference.coverage import coverage_factor, effective_freedom
from calib.instruments.common_errors import CommonError
from calib.poses import poses_at
from calib.prediction.budget import Budget, budget_of, combined
from calib.prediction.estimate import estimate_of
from studies.demo.embedded import simulated
from tests.calib.prediction import common_days as days

DAYS = 1000
TARGETS = days.joints(12, np.random.default_rng(77))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One day's table, with cells that state its common errors and that do not."""
    folder = tmp_path_factory.mktemp("day")
    rng = np.random.default_rng(3)
    q = days.joints(18, rng)
    day = days.drawn(rng)
    table = days.table(q, days.read(days.points(days.TRUE, q, day["level"]), day, rng))
    for name, common in (("stated", days.COMMON), ("silent", "")):
        (folder / name).mkdir()
        (folder / name / "data.csv").write_text(table)
        days.write_cell(folder / name, common)
    return folder


def identified(folder: Path) -> Identification:
    cell = calib.load_cell(folder / "cell.toml")
    return calib.identify(cell, calib.load_measurements(cell, folder / "data.csv"))


def budget_at(found: Identification, q: Array) -> Budget:
    return budget_of(found, estimate_of(found), poses_at(q), np.ones(len(q)))


@dataclass(frozen=True, eq=False)
class World:
    """The truth at the poses that are measured and at the targets, linear about it.

    gain : least squares of its own; at_targets : derivatives; level : by gravity turned, of both
    """

    true: Array
    gain: Array
    at_targets: Array
    level: tuple[Array, Array]

    def missed(self, only: str = "", noise: bool = True) -> Array:
        """RMS errors over the markers at each target on many days, shape (days, m)."""
        rng, out = np.random.default_rng(5), []
        for _ in range(DAYS):
            day = days.drawn(rng, only)
            off = days.read(self.true, day, rng if noise else None) - self.true
            off = off + np.tensordot(day["level"], self.level[0], 1)
            told = (self.at_targets @ (self.gain @ off.ravel())).reshape(len(TARGETS), 3, 3)
            out.append(told - np.tensordot(day["level"], self.level[1], 1))
        return np.asarray(np.sqrt((np.array(out) ** 2).sum(axis=-1).mean(axis=-1)))


@pytest.fixture(scope="module")
def world(folder: Path) -> World:
    q = identified(folder / "silent").fit.data.poses.q

    def by_level(poses: Array) -> Array:
        both = [
            [days.points(days.TRUE, poses, sign * tilt) for sign in (1.0, -1.0)]
            for tilt in 1e-3 * np.eye(2)
        ]
        return np.array([(ahead - back) / 2e-3 for ahead, back in both])

    return World(
        days.points(days.TRUE, q),
        np.linalg.pinv(days.slopes(days.TRUE, q)),
        days.slopes(days.TRUE, TARGETS),
        (by_level(q), by_level(TARGETS)),
    )


def test_total_and_intervals_hold_over_a_thousand_days(folder: Path, world: World) -> None:
    found = identified(folder / "stated")
    budget = budget_at(found, TARGETS)
    told = budget.expected
    errors = world.missed()
    simulated = np.sqrt((errors**2).mean())
    assert budget.rms(told.errors) == pytest.approx(simulated, rel=0.05)
    np.testing.assert_allclose(told.errors, np.sqrt((errors**2).mean(axis=0)), rtol=0.08)
    held = (errors <= told.expanded).mean(axis=0)
    assert held.mean() == pytest.approx(0.95, abs=0.015)
    assert np.abs(held - 0.95).max() < 0.03
    # Without its common errors the same budget promises far too much.
    alone = combined(budget.calibration[:1], budget.weights)
    assert (errors <= alone.expanded).mean() < 0.1


@pytest.mark.parametrize("name", list(days.STATED))
def test_each_row_is_what_its_source_does(folder: Path, world: World, name: str) -> None:
    found = identified(folder / "stated")
    budget = budget_at(found, TARGETS)
    part = budget.calibration[1 + list(days.STATED).index(name)]
    errors = world.missed(name, noise=False)
    assert budget.rms(part.errors) == pytest.approx(np.sqrt((errors**2).mean()), rel=0.08)


def test_parameters_are_as_uncertain_as_refits_scatter(folder: Path, world: World) -> None:
    found, silent = identified(folder / "stated"), identified(folder / "silent")
    np.testing.assert_array_equal(found.values, silent.values)
    np.testing.assert_array_equal(found.covariance, silent.covariance)
    assert not silent.common
    rng, changes = np.random.default_rng(8), []
    for _ in range(DAYS):
        day = days.drawn(rng)
        off = days.read(world.true, day, rng) - world.true
        changes.append(world.gain @ (off + np.tensordot(day["level"], world.level[0], 1)).ravel())
    # The robot's own parameters mean the same in both; the base is turned another way.
    names = [p.id for p in found.model.parameters]
    own = [i for i, name in enumerate(names) if name.startswith("joint_")]
    std = np.array(changes)[:, 15:].std(axis=0)
    np.testing.assert_allclose(std, found.std[own], rtol=0.08)
    assert (found.std[own] > 1.5 * silent.std[own]).any()


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"method": "two-step"},
        {"approach": "pose"},
        {"approach": "pose", "weighting": "plain"},
    ],
    ids=str,
)
def test_refits_move_as_the_response_says(
    kr270: Cell, table_two: Poses, how: dict[str, Any]
) -> None:
    """By every way of estimating: readings of a tracker whose metre is 20 um long, fitted again."""
    data, _, _ = simulated(kr270, table_two, 1)
    scale = CommonError("scale_um_m", 20e-6)
    cell = replace(kr270, instruments=(replace(kr270.tracker, common=(scale,)),))
    found = calib.identify(cell, data, **how)
    again = calib.identify(cell, replace(data, readings=data.readings * (1.0 + 20e-6)), **how)
    moved, told = again.values - found.values, found.common[0].response[:, 0]
    assert np.abs(moved / found.std).max() > 0.3
    np.testing.assert_allclose(moved / found.std, told / found.std, atol=0.01)


SLIDE = """schema = 1
[robot]
dh = "slide.csv"
dh_convention = "classic"
repeatability_mm = 0
[robot.limits_mm]
X = [0, 2000]
[markers_mm]
m = [0, 0, 0]
[instrument]
sigma_mm = 0.01
[instrument.common]
scale_um_m = 3
r0_um = { limit = 10, distribution = "rectangular", degrees_of_freedom = 8 }
[model]
effects = ["transmission_scale:X"]
"""


def test_a_slide_by_hand(tmp_path: Path) -> None:
    """A tracker in the origin of a slide reads 0.5, 1.0 and 1.5 m along it; only its pitch is unknown.

    The pitch follows readings d by sum(q d) / sum(q q), sum(q q) = 3.5 m2. At 2 m that makes of a scale
    of 3 um/m 6 um, of a zero point u = 10 um / sqrt 3 = 5.77 um 2 (3.0 / 3.5) u = 9.90 um, and of noise
    of 10 um 2 x 10 / sqrt 3.5 = 10.69 um. Along one line all, so u = sqrt(36 + 97.96 + 114.29) =
    15.76 um, with nu = 8 (248.24 / 97.96)^2 = 51.4 degrees of freedom, k = 2.007, U = 31.6 um.
    """
    (tmp_path / "slide.csv").write_text(
        "joint,kind,alpha_deg,a_mm,theta_deg,d_mm\nX,prismatic,0,0,0,0\n"
    )
    (tmp_path / "cell.toml").write_text(SLIDE)
    # Noise of 10 um across the slide, which tells nothing of its pitch.
    rows = [
        f"p{k},m,{z},{x},{x},{z}"
        for k, (x, z) in enumerate(((0.01, 500), (-0.01, 1000), (0.01, 1500)))
    ]
    (tmp_path / "data.csv").write_text("\n".join(["pose,marker,X_mm,x_mm,y_mm,z_mm", *rows, ""]))
    found = identified(tmp_path)
    budget = budget_at(found, np.array([[2.0]]))
    um = [1e6 * budget.rms(part.errors) for part in budget.calibration]
    np.testing.assert_allclose(um, [10.690, 6.0, 9.897], rtol=1e-4)
    np.testing.assert_allclose(
        [1e6 * (part.std or 0.0) for part in budget.calibration], [10.0, 3.0, 5.7735], rtol=1e-4
    )
    told = budget.expected
    assert told.freedom == pytest.approx(51.4, abs=0.1)
    assert 1e6 * budget.rms(told.expanded) == pytest.approx(31.63, abs=0.02)


def test_the_gauge_block_of_the_guide() -> None:
    """JCGM 100, H.1: five influences, 16.7 degrees of freedom, t of 99 % 2.92 at 16, U = 93 nm."""
    parts = [(25.0**2, 18.0), (9.7**2, 25.6), (2.9**2, 50.0), (16.6**2, 2.0)]
    nu = float(effective_freedom(parts))
    assert nu == pytest.approx(16.7, abs=0.2)
    factor = float(coverage_factor(np.floor(nu), level=0.99))
    assert factor == pytest.approx(2.92, abs=0.005)
    assert factor * np.sqrt(sum(v for v, _ in parts)) == pytest.approx(93.0, abs=1.0)


def test_coverage_in_space() -> None:
    """95 % of the lengths of a normal error in space lie within 2.795 standard deviations."""
    each = float(coverage_factor(np.inf, 3.0)) * np.sqrt(3.0)
    assert each == pytest.approx(2.7955, abs=1e-3)
