"""Corrected commands run through arms in MuJoCo that share no code with the model.

The arms have wrong geometry, soft joints, a payload, 2400 N on the heavy one, and causes written by
hand. Errors are those of the markers in the instrument's frame, from where the identified base puts the
nominal pose: base and flange of such an arm are known by nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("mujoco")

import calib
from calib import Cell, Measurements
from calib.prediction.compensate import Compensation
from calib.prediction.estimate import Estimate, estimate_of
from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import Case, draw_scene
from studies.research.withheld.robots import ARMS, HEAVY, LIGHT, Arm
from studies.research.withheld.visible import at_rest
from tests.calib.test_compensate import band, missed, wanted
from tests.studies.research.withheld.scenes import PLAIN, as_files, case_of

pytestmark = pytest.mark.long

CONDITIONS = replace(PLAIN, configurations=45, known_geometry=False)


def measured(arm: Arm, seed: int, *causes: Cause, louder: float = 1.0) -> Case:
    """A session with noise on an arm with errors of every kind that the user's model has.

    louder : actual over stated noise of the instrument
    """
    rng = np.random.default_rng(seed)
    case = case_of(draw_scene(rng, arm, CONDITIONS), *causes)
    noise = case.scene.noise.coloured(rng.normal(size=case.clean.shape), case.clean)
    return replace(case, conditions=CONDITIONS, noisy=case.clean + louder * noise)


def files(folder: Path, case: Case) -> tuple[Cell, Measurements, Measurements]:
    """Cell, data, and the held-out poses that serve as targets, as a user has them."""
    cell, data = as_files(folder / "case", case)
    return cell, data, calib.load_measurements(cell, folder / "case" / "heldout.csv")


def true_points(case: Case, q: Array) -> Array:
    """Where the markers of the true arm are at the held-out readings, driven to other joints."""
    scene, session = case.scene, case.scene.session
    driven = session.q.copy()
    driven[session.held] = q
    moved = replace(scene, session=replace(session, q=driven))
    return at_rest(moved, scene.mechanism(), case.causes).aimed[session.held]


def ratio_of(case: Case, known: Estimate, found: Compensation) -> tuple[float, float, float]:
    """RMS before and after [m] on the true arm, and the latter over what was expected."""
    places = wanted(known, found)
    before, after = (missed(true_points(case, q), places) for q in (found.targets.q, found.q))
    ratio = np.sqrt(after.mean() / (found.expected**2).mean())
    return float(np.sqrt(before.mean())), float(np.sqrt(after.mean())), float(ratio)


@pytest.mark.parametrize("arm", ARMS, ids=[arm.name for arm in ARMS])
def test_true_arm_is_where_it_should_be(arm: Arm, tmp_path: Path) -> None:
    """Geometry, payload and load: the error falls to what the covariance says."""
    case = measured(arm, 2)
    cell, data, targets = files(tmp_path, case)
    result = calib.identify(cell, data)
    found = calib.compensate(cell, result, targets.poses)
    known = estimate_of(result)
    before, after, ratio = ratio_of(case, known, found)
    low, high = band(known, replace(found.targets, q=found.q))
    assert len(found.q) >= 40
    assert found.left.max() < 1e-7
    assert before > 1e-3
    assert after < 1e-5
    assert low < ratio < high
    assert found.rms(found.before) == pytest.approx(before, rel=0.01)


def test_a_noisy_instrument_is_not_expected_at_the_targets(tmp_path: Path) -> None:
    """Three times the stated noise: the parameters suffer, the true arm at its targets does not."""
    came, stated = [], []
    for seed in range(3):
        case = measured(LIGHT, seed, louder=3.0)
        cell, data, targets = files(tmp_path / str(seed), case)
        result = calib.identify(cell, data)
        found = calib.compensate(cell, result, targets.poses)
        known = estimate_of(result)
        assert known.discrepancy.rms == found.error.arm.max() == 0.0
        _, after, ratio = ratio_of(case, known, found)
        low, high = band(known, replace(found.targets, q=found.q))
        assert low < ratio < high
        came.append(after)
        stated.append(after / ratio)
    ratio = float(np.linalg.norm(came) / np.linalg.norm(stated))
    assert 0.8 < ratio < 1.2


def test_named_cause_is_corrected(tmp_path: Path) -> None:
    """Backlash that only the diagnosis knows of: gone with it, left over without."""
    case = measured(HEAVY, 5, Cause("backlash", "A3", {"half_width": 8e-5}))
    cell, data, targets = files(tmp_path, case)
    result = calib.diagnose(cell, data)
    assert [c.named.candidate.key for c in result.causes] == ["backlash:A3"]
    known = estimate_of(result)
    found = calib.compensate(cell, result, targets.poses)
    before, after, ratio = ratio_of(case, known, found)
    low, high = band(known, replace(found.targets, q=found.q))
    assert before > 1e-3
    assert low < ratio < high
    plain = calib.identify(cell, data)
    without = ratio_of(case, estimate_of(plain), calib.compensate(cell, plain, targets.poses))
    assert without[1] > 4.0 * after


def test_located_rest_is_part_of_what_is_expected(tmp_path: Path) -> None:
    """A third harmonic, of which no ripple is made: it stays, and the expected error says so."""
    case = measured(HEAVY, 5, Cause("third_harmonic", "A4", {"a": 1.5e-4, "b": 1e-4}))
    cell, data, targets = files(tmp_path, case)
    cell = replace(cell, excluded=("gear_ripple",))
    result = calib.diagnose(cell, data, heldout=targets)
    found = calib.compensate(cell, result, targets.poses)
    before, after, ratio = ratio_of(case, estimate_of(result), found)
    assert "not corrected: the gap located at A4 by q:A4" in " ".join(found.notes)
    assert found.error.estimate.configuration_of == "model"
    assert found.rms(found.error.model) > 2.0 * case.scene.noise.sigma
    assert after < before / 20.0
    assert 0.8 < ratio < 1.25  # the same poses are held out and aimed at
