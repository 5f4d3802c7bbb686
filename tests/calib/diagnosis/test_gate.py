"""What is left out is predicted as a refit without it predicts it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cell import Cell
from calib.diagnosis.candidates import Candidate, candidates
from calib.diagnosis.gate import CrossValidation
from calib.diagnosis.stage import Stage
from calib.instruments import KnownDistance, Socket
from calib.poses import Measurements
from tests.calib.diagnosis.test_diagnose import measured
from tests.calib.instruments.test_touching import ONE, SITES, contacts_of_a_larger_arm
from tests.helpers import cell_of, random_robot, stage_of


def asked(cell: Cell, data: Measurements) -> tuple[Stage, list[Candidate]]:
    stage = stage_of(cell, data)
    return stage, candidates(cell, stage.model, data)[0]


def predicted(stage: Stage, effects: list[Candidate], by_time: bool) -> float:
    """3-D RMS of what is a length at folds predicted by refits without them, m."""
    data = stage.data
    fold = CrossValidation.of(stage, stage.fit(()), by_time).fold
    lengths = stage.model.readout.channels.lengths
    squares = 0.0
    for f in range(int(fold.max()) + 1):
        fit = replace(stage, dropped=fold == f).fit([c.effect for c in effects])
        part: Measurements = data.take(fold == f)
        squares += float((fit.model.off(fit.values, part) ** 2 * lengths).sum())
    return float(np.sqrt(squares / (data.seen & lengths.any(axis=-1)).sum()))


@pytest.mark.long
@pytest.mark.parametrize("by_time", [False, True])
def test_left_out_errors_are_those_of_refits(by_time: bool) -> None:
    cell, data, _ = measured("backlash:A3", [2e-4])
    stage, suspects = asked(cell, data)
    right = next(c for c in suspects if c.key == "backlash:A3")
    wrong = next(c for c in suspects if c.key == "backlash:A5")  # of one parameter: no common size
    fit = stage.fit([right.effect, wrong.effect])
    both = predicted(stage, [right, wrong], by_time)
    crossed = CrossValidation.of(stage, fit, by_time)
    for member, rest in ((right, wrong), (wrong, right)):
        found = crossed.errors([member.effect])
        assert found.rms_with == pytest.approx(both, rel=0.02)
        assert found.rms_without == pytest.approx(predicted(stage, [rest], by_time), rel=0.02)
    assert crossed.errors([right.effect]).earns
    assert not crossed.errors([wrong.effect]).earns


def test_beside_a_camera_lengths_alone_are_told_in_mm(tmp_path: Path) -> None:
    """A pixel is no metre: the errors are those of the tracker's points."""
    from tests.camera_days import SETUPS, Truth, kr270_day

    off = np.array([0.0, 0.0, 8e-4, 0.0, 0.0, 0.0])
    setup = SETUPS["kr270"]
    cell, data = kr270_day(tmp_path, setup, Truth(off), 24, effects='"base", "tool"')
    stage, suspects = asked(cell, data)
    right = next(c for c in suspects if c.key == "joint_offset:A3")
    fit = stage.fit([right.effect])
    found = CrossValidation.of(stage, fit, by_time=False).errors([right.effect])
    assert found.rms_without == pytest.approx(predicted(stage, [], False), rel=0.1)
    assert found.rms_with == pytest.approx(predicted(stage, [right], False), rel=0.05)
    assert found.rms_with < 1e-4 < found.rms_without < 3e-3


@pytest.mark.parametrize("by_time", [pytest.param(False, marks=pytest.mark.long), True])
def test_known_distances_hold_the_arm_s_size(by_time: bool) -> None:
    """Contacts alone are met by an arm without any length: what is known of lengths counts as well."""
    rng, robot = np.random.default_rng(2), random_robot(np.random.default_rng(12), 6)
    data, centres = contacts_of_a_larger_arm(robot)
    q = data.poses.q + 2e-5 * rng.normal(size=data.poses.q.shape)
    q[:, 2] -= 6e-4 * np.sin(data.poses.q[:, 2])
    data = replace(data, poses=replace(data.poses, q=q))
    pairs = [
        KnownDistance(
            (SITES[a], SITES[b]), float(np.sqrt(((centres[a] - centres[b]) ** 2).sum())), 1e-5
        )
        for a, b in ((0, 1), (2, 3))
    ]
    cell = cell_of(robot, ONE + np.array([0.08, -0.05, 0.06]), ("tool", "geometry"))
    sockets = Socket(name="a", sigma=2e-5, sites=SITES)
    cell = replace(cell, instruments=(sockets,), known_distances=tuple(pairs))
    stage, suspects = asked(cell, data)
    right = next(c for c in suspects if c.key == "transmission_harmonic:j3")
    fit = stage.fit([right.effect])
    found = CrossValidation.of(stage, fit, by_time).errors([right.effect])
    assert found.rms_with == pytest.approx(predicted(stage, [right], by_time), rel=0.02)
    assert found.rms_without == pytest.approx(predicted(stage, [], by_time), rel=0.02)
    assert found.rms_with > 1e-5
    assert found.earns
