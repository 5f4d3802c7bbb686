"""``posecal compensate`` as a user sees it, and corrected commands run through arms in MuJoCo."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import calib
from calib import Cell, Diagnosis, Identification, Measurements
from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.estimate import load_estimate
from calib.prediction.compensate import Compensation
from calib.prediction.estimate import estimate_of
from studies.research.sealed.draw import Case
from studies.research.truth.arms import ARMS, HEAVY, LIGHT, Arm
from studies.research.truth.causes import Cause
from studies.research.truth.scene import at_rest, draw_scene
from studies.results.estimate import Estimated
from tests.calib.test_compensate import band, missed, wanted
from tests.studies.command_line import ran, refused, result
from tests.studies.research.sealed.scenes import PLAIN, as_files, case_of


def call(demo: Path) -> tuple[object, ...]:
    return "compensate", demo / "cell.toml", demo / "result.json", demo / "targets.csv"


@pytest.fixture(scope="module")
def told(demo: Path) -> tuple[dict[str, Any], str]:
    """The JSON of corrected commands, beside their table, and what is printed."""
    return result(demo / "c.json", *call(demo), "-o", demo / "c.csv", kind="compensate")


def test_table_is_the_targets_with_corrected_joints(
    demo: Path, told: tuple[dict[str, Any], str]
) -> None:
    fields, said = told
    rows = list(csv.DictReader((demo / "c.csv").read_text().splitlines()))
    cell = calib.load_cell(demo / "cell.toml")
    plan = calib.load_plan(cell, demo / "c.csv")
    again, weights = calib.load_targets(cell, demo / "c.csv")
    for q, target, row in zip(plan.q, fields["targets"], rows, strict=True):
        expected = [target["joints_deg"][joint] for joint in cell.robot.joints]
        np.testing.assert_allclose(np.degrees(q), expected, atol=2e-6)
        change = [float(row[f"change_{joint}_mdeg"]) for joint in cell.robot.joints]
        shown = [target["correction_joints_deg"][joint] for joint in cell.robot.joints]
        np.testing.assert_allclose(change, np.array(shown) * 1e3, atol=2e-3)
    np.testing.assert_array_equal(again.q, plan.q)
    np.testing.assert_array_equal(weights, [1.0, 2.0, 1.0, 1.0])
    assert [row["limited_by"] for row in rows] == ["", "", "", "singular"]
    assert "1 of 4 targets are only partly corrected" in said
    assert "holds corrected commands already" in refused(*call(demo)[:3], demo / "c.csv")


def test_json_says_before_and_after(demo: Path, told: tuple[dict[str, Any], str]) -> None:
    fields, _ = told
    assert fields["command"] == "compensate"
    named = [Path(entry["file"]).name for entry in fields["inputs"]]
    assert named == ["cell.toml", "kr270.urdf", "result.json", "targets.csv"]
    rms, expected = fields["rms_mm"], fields["expected"]
    assert rms["expected"] == pytest.approx(np.hypot(rms["left"], expected["rms_mm"]), rel=1e-6)
    parts = [expected[f"{name}_mm"] for name in ("parameters", "arm", "model")]
    assert expected["rms_mm"] == pytest.approx(np.linalg.norm(parts), rel=1e-6)
    assert rms["before"] > 100 * rms["expected"]
    weights = np.array([1.0, 2.0, 1.0, 1.0])
    before = np.array([t["before_mm"] for t in fields["targets"]])
    assert rms["before"] == pytest.approx(np.sqrt(weights @ before**2 / 5.0))
    assert fields["errors_at"] == "markers"
    assert fields["limited"] == {"singular": 1}
    assert fields["warnings"] == []
    cell = calib.load_cell(demo / "cell.toml")
    found = calib.compensate(cell, demo / "result.json", demo / "targets.csv")
    assert found.rms(found.expected) * 1e3 == pytest.approx(rms["expected"], rel=1e-6)


@pytest.mark.long
def test_estimate_is_read_back_as_it_was(demo: Path, tmp_path: Path) -> None:
    """Knots that the cell does not give, and effects of a diagnosis, come from the result alone."""
    text = (demo / "cell.toml").read_text()
    shutil.copy(demo / "kr270.urdf", tmp_path)
    cell_path = tmp_path / "cell.toml"
    cell_path.write_text(re.sub(r"\[model.knots_deg\][^=]*=.*", "", text))
    cell = calib.load_cell(cell_path)
    assert "A2" not in cell.knots
    data = calib.load_measurements(cell, demo / "measurements.csv")
    for command, found in (("identify", calib.identify), ("diagnose", calib.diagnose)):
        known = estimate_of(found(cell, data))
        path = tmp_path / f"{command}.json"
        entry = Estimated.of(known).model_dump(by_alias=True)
        path.write_text(json.dumps({"command": command, "estimate": entry}))
        read = load_estimate(cell, path)
        assert [p.id for p in read.model.parameters] == [p.id for p in known.model.parameters]
        np.testing.assert_array_equal(read.values, known.values)
        np.testing.assert_array_equal(read.covariance, known.covariance)
        assert read.start == known.start
        assert read.discrepancy == known.discrepancy
        q = calib.load_targets(cell, demo / "targets.csv")[0]
        np.testing.assert_allclose(
            calib.compensate(cell, read, q).q, calib.compensate(cell, known, q).q, atol=1e-9
        )


def test_a_cell_that_changed_is_said(demo: Path, tmp_path: Path) -> None:
    shutil.copy(demo / "kr270.urdf", tmp_path)
    path = tmp_path / "cell.toml"
    path.write_text((demo / "cell.toml").read_text() + "\n# edited\n")
    said = ran("compensate", path, *call(demo)[2:])
    assert f"warning: {path} changed since" in said
    assert "kr270.urdf changed" not in said


def test_commands_that_do_not_keep_clear_are_told(demo: Path, tmp_path: Path) -> None:
    """A ball around the forearm at the first target: that command is named."""
    cell = calib.load_cell(demo / "cell.toml")
    targets, _ = calib.load_targets(cell, demo / "targets.csv")
    frames = forward(cell.robot, targets.q)
    x, y, z = 1e3 * frames.o[0, 4]
    shapes = "\n[robot.capsules_mm]\nA3 = [{ from = [0, 0, 0], to = [1000, 0, 0], radius = 50 }]\n"
    ball = f'[[design.obstacle]]\ntype = "sphere"\ncenter_mm = [{x}, {y}, {z}]\nradius_mm = 150\n'
    path = demo / "guarded.toml"
    path.write_text((demo / "cell.toml").read_text() + shapes + ball)
    fields, said = result(tmp_path / "c.json", "compensate", path, *call(demo)[2:])
    assert fields["not_clear"] == {targets.names[0]: "obstacle 1 (sphere)"}
    assert f"the arm does not keep clear at the corrected command of {targets.names[0]}" in said


# -- Corrected commands of arms in MuJoCo

CONDITIONS = replace(PLAIN, configurations=45, known_geometry=False)


def measured(arm: Arm, seed: int, *causes: Cause, louder: float = 1.0) -> Case:
    """A session with noise on an arm with errors of every kind that the user's model has.

    louder : actual over stated noise of the instrument
    """
    rng = np.random.default_rng(seed)
    case = case_of(draw_scene(rng, arm, CONDITIONS), *causes)
    noise = case.scene.noise.coloured(rng.normal(size=case.clean.shape), case.clean)
    return replace(case, noisy=case.clean + louder * noise)


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


class Met(NamedTuple):
    """before, after : RMS on the true arm, m; ratio : of after to what was expected, low to high"""

    found: Compensation
    before: float
    after: float
    low: float
    ratio: float
    high: float


def met(case: Case, cell: Cell, result: Identification | Diagnosis, targets: Measurements) -> Met:
    """What the commands of a result do on the true arm."""
    known, found = estimate_of(result), calib.compensate(cell, result, targets.poses)
    places = wanted(known, found)
    before, after = (
        float(np.sqrt(missed(true_points(case, q), places).mean()))
        for q in (found.targets.q, found.q)
    )
    low, high = band(known, replace(found.targets, q=found.q))
    return Met(found, before, after, low, after / found.rms(found.expected), high)


@pytest.mark.long
@pytest.mark.parametrize("arm", ARMS, ids=[arm.name for arm in ARMS])
def test_true_arm_is_where_it_should_be(arm: Arm, tmp_path: Path) -> None:
    """Geometry, payload and load: the error falls to what the covariance says."""
    case = measured(arm, 2)
    cell, data, targets = files(tmp_path, case)
    own = met(case, cell, calib.identify(cell, data), targets)
    assert len(own.found.q) >= 40
    assert own.found.left.max() < 1e-7
    assert own.before > 1e-3
    assert own.after < 1e-5
    assert own.low < own.ratio < own.high
    assert own.found.rms(own.found.before) == pytest.approx(own.before, rel=0.01)


@pytest.mark.long
def test_a_noisy_instrument_is_not_expected_at_the_targets(tmp_path: Path) -> None:
    """Three times the stated noise: the parameters suffer, the true arm at its targets does not."""
    came, stated = [], []
    for seed in range(2):
        case = measured(LIGHT, seed, louder=3.0)
        cell, data, targets = files(tmp_path / str(seed), case)
        own = met(case, cell, calib.identify(cell, data), targets)
        assert own.found.error.estimate.discrepancy.rms == own.found.error.arm.max() == 0.0
        assert own.low < own.ratio < own.high
        came.append(own.after)
        stated.append(own.after / own.ratio)
    ratio = float(np.linalg.norm(came) / np.linalg.norm(stated))
    assert 0.8 < ratio < 1.2


@pytest.mark.long
def test_named_cause_is_corrected(tmp_path: Path) -> None:
    """Backlash that only the diagnosis knows of: gone with it, left over without."""
    case = measured(HEAVY, 5, Cause("backlash", "A3", {"half_width": 8e-5}))
    cell, data, targets = files(tmp_path, case)
    found = calib.diagnose(cell, data)
    assert [c.named.candidate.key for c in found.causes] == ["backlash:A3"]
    own = met(case, cell, found, targets)
    assert own.before > 1e-3
    assert own.low < own.ratio < own.high
    assert met(case, cell, calib.identify(cell, data), targets).after > 4.0 * own.after


@pytest.mark.long
def test_located_rest_is_part_of_what_is_expected(tmp_path: Path) -> None:
    """A third harmonic, of which no ripple is made: it stays, and the expected error says so."""
    case = measured(HEAVY, 5, Cause("third_harmonic", "A4", {"a": 1.5e-4, "b": 1e-4}))
    cell, data, targets = files(tmp_path, case)
    cell = replace(cell, excluded=("gear_ripple",))
    own = met(case, cell, calib.diagnose(cell, data, heldout=targets), targets)
    assert "not corrected: the gap located at A4 by q:A4" in " ".join(own.found.notes)
    assert own.found.error.estimate.configuration_of == "model"
    assert own.found.rms(own.found.error.model) > 2.0 * case.scene.noise.sigma
    assert own.after < own.before / 20.0
    assert 0.8 < own.ratio < 1.25  # the same poses are held out and aimed at
