"""The paper's tables against their reproduction, by two programs and by simulation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import calib
from calib.arrays import Array
from studies.compare.experiment import PLAIN, POINTS
from studies.compare.simulate import agreement
from studies.demo.embedded import embedded_plan
from studies.research.paper import elastostatic, table_one
from studies.research.paper.elastostatic import KNOWN, MICRO
from studies.research.paper.elastostatic import NAMES as ELASTIC

PAPER = json.loads((Path(__file__).parents[2] / "reference" / "paper.json").read_text())
PRINTED = PAPER["table_I"]
NAMES = ("l1", "l2", "l3", "q1", "q2", "q3")
LINKS = np.array([1.003, 0.802, 0.605])  # m, nominal and error
OFFSETS = np.radians([1.0, 0.5, 2.0])  # true joint angle minus the one read
SIGMA = 1e-5  # m, each coordinate of a marker
KEYS = {"approach_1": PLAIN.key, "approach_2": POINTS.key}


def test_embedded_figures_are_those_printed() -> None:
    embedded = table_one.embedded()["printed"]
    for key in ("approach_1", "approach_2", "improvement"):
        assert embedded[key] == PRINTED[key]
    assert embedded["parameters"] == list(NAMES) == list(table_one.PARAMETERS)


def test_all_twelve_figures_are_reproduced() -> None:
    found = table_one.predictions_at(table_one.experiment_at(table_one.embedded_setting()))
    for key, way in KEYS.items():
        ours = found[way].std / table_one.SCALES
        printed = np.array(PRINTED[key])  # to 15 %, or to the rounding of three decimals
        assert ((np.abs(ours / printed - 1.0) <= 0.15) | (np.abs(ours - printed) <= 0.5e-3)).all()
        np.testing.assert_allclose(ours, PRINTED["reproduced"][key], rtol=0.01)
    factors = found[PLAIN.key].std / found[POINTS.key].std
    np.testing.assert_allclose(factors, PRINTED["improvement"], rtol=0.15)


def test_a_second_program_predicts_the_same() -> None:
    """Equation (21) in closed form, which shares nothing with the model."""
    setting = table_one.embedded_setting()
    found = table_one.predictions_at(table_one.experiment_at(setting))
    for own, way in zip(predicted(setting), KEYS.values(), strict=True):
        np.testing.assert_allclose(found[way].std, own, rtol=1e-9)


def predicted(setting: table_one.Setting) -> Array:
    """First-order standard deviations under approaches #1 and #2, shape (2, 6), m and rad."""
    arms, J = jacobian(setting)
    points = np.linalg.pinv(J.reshape(-1, 6))
    # Approach #1 sees the markers only through the pose that plain least squares computes from them.
    turning = np.cross(arms[..., None, :], np.eye(3))  # minus the cross product's matrix
    A = np.concatenate([np.broadcast_to(np.eye(3), turning.shape), turning], axis=-1)
    weights = np.array([1.0] * 3 + [setting.length] * 3)
    P = weights[:, None] * np.linalg.pinv(A.reshape(3, 9, 6))
    gain = np.linalg.pinv((P @ J.reshape(3, 9, 6)).reshape(-1, 6)).reshape(6, 3, 6)
    poses = np.einsum("kic,icr->kir", gain, P).reshape(6, -1)
    return np.asarray(SIGMA * np.linalg.norm(np.stack([poses, points]), axis=-1))


def jacobian(setting: table_one.Setting) -> tuple[Array, Array]:
    """Markers relative to the end point, and their derivatives by ``NAMES``, in base axes.

    Shapes (3, 3, 3), m, and (3, 3, 3, 6), m/m and m/rad: pose, marker, coordinate, parameter.
    """
    q1, q2, q3 = (setting.q + OFFSETS).T[..., None]
    up = np.array([0.0, 0.0, 1.0])
    ahead = np.concatenate([np.cos(q1), np.sin(q1), 0 * q1], axis=1)
    side = np.cross(up, ahead)
    link_2 = np.cos(q2) * ahead + np.sin(q2) * up
    link_3 = np.cos(q2 + q3) * ahead + np.sin(q2 + q3) * up
    frame = np.stack([link_3, side, np.cross(link_3, side)], axis=-1)
    arms = np.einsum("iab,jb->ija", frame, setting.markers)
    from_elbow = arms + LINKS[2] * link_3[:, None]
    from_shoulder = from_elbow + LINKS[1] * link_2[:, None]
    columns = [up, link_2[:, None], link_3[:, None], np.cross(up, from_shoulder)]
    # q2 and q3 count upwards, which turns about -y.
    columns += [np.cross(-side[:, None], r) for r in (from_shoulder, from_elbow)]
    return arms, np.stack([np.broadcast_to(c, arms.shape) for c in columns], axis=-1)


@pytest.mark.long
def test_a_thousand_calibrations_scatter_as_predicted() -> None:
    experiment = table_one.experiment_at(table_one.embedded_setting())
    found = table_one.predictions_at(experiment)
    done = table_one.simulated(experiment, 1000)
    for way in KEYS.values():
        assert done[way].settled.all()
        errors = done[way].errors
        judged = agreement(errors, found[way].covariance)
        assert judged is not None
        assert (np.abs(judged.std / found[way].std - 1.0) < 3.0 / np.sqrt(2.0 * len(errors))).all()
        bias = errors.mean(axis=0) / (judged.std / np.sqrt(len(errors)))
        assert (np.abs(bias) < 4.0).all(), "means equal the assigned values"
        assert judged.p > 0.01


def test_printed_side_by_side() -> None:
    done = CliRunner().invoke(table_one.main, ["--trials", "50"])
    assert done.exit_code == 0, done.output
    line = next(row for row in done.output.splitlines() if row.startswith("dq2"))
    assert line.split()[:4] == ["dq2", "mdeg", "3.742", "3.650"]


# -- Tables II to IV from a simulated campaign


@pytest.fixture(scope="module")
def campaign() -> tuple[calib.Measurements, calib.Cell, np.ndarray, list[int]]:
    cell = elastostatic.cell_of_section_five("base", "tool")
    data, model, truth = elastostatic.measured(cell)
    return data, cell, truth, elastostatic.compliances(model)


def test_elastostatic_figures_are_those_printed() -> None:
    own, four = elastostatic.tables(), PAPER["table_IV"]
    angles = ("-0.01", "-25.24", "-56.9", "-99.85", "-140")
    rest = ("A3", "A4", "A5", "A6")
    assert own["compliance"] == [four["A2_at_deg"][a] for a in angles] + [four[j] for j in rest]
    printed = four["interval"]
    assert own["interval"] == [printed["A2_at_deg"][a] for a in angles] + [printed[j] for j in rest]


def test_both_solvers_find_table_four(
    campaign: tuple[calib.Measurements, calib.Cell, np.ndarray, list[int]],
) -> None:
    data, cell, truth, order = campaign
    found = elastostatic.identified(data, cell)
    joint, turns = found["joint"], found["two-step"]
    np.testing.assert_allclose(turns.values, joint.values, atol=1e-6 * joint.std.max(), rtol=1e-6)
    for result in found.values():
        error = (result.values - truth) / result.std
        assert np.abs(error[order]).max() < 4.0
        assert result.noise.source == "cell"
    base = (joint.values - truth)[:6] / joint.std[:6]
    assert np.abs(base).max() < 4.0, "Table III"


def test_intervals_fix_the_unit() -> None:
    """Printed over predicted of chi_21 .. chi_4 is near one at 1e-6 rad/(N m), and nowhere else."""
    cell = elastostatic.cell_of_section_five()
    printed = np.array(elastostatic.tables()["interval"])
    for com in ((0.3, 0.0, 0.15), (0.1, 0.2, -0.3), (0.5, -0.3, 0.2)):
        std = elastostatic.predicted(np.array(com), embedded_plan(cell), cell)
        ratio = (printed * MICRO / std)[KNOWN]
        assert ratio.min() > 0.4
        assert ratio.max() < 2.5


def test_the_last_joints_depend_on_the_load_point() -> None:
    cell = elastostatic.cell_of_section_five()
    plan = embedded_plan(cell)
    near = elastostatic.predicted(np.array([0.3, 0.0, 0.05]), plan, cell)
    far = elastostatic.predicted(np.array([0.3, 0.0, 0.4]), plan, cell)
    ratio = near / far
    assert ratio[8] > 3.0
    assert ratio[KNOWN].max() < 1.3
    with np.errstate(invalid="ignore", divide="ignore"):
        on_axis = elastostatic.predicted(np.array([0.3, 0.0, 0.0]), plan, cell)
    assert not on_axis[8] <= 1e3 * far[8]


def test_printed_tables() -> None:
    done = CliRunner().invoke(elastostatic.main, [])
    assert done.exit_code == 0, done.output
    for name in ELASTIC:
        assert sum(line.startswith(name) for line in done.output.splitlines()) == 2, name
    assert "1e-6 rad/(N m)" in done.output
