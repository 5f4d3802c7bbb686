"""What is left out is predicted as a refit without it predicts it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cell import Cell
from calib.diagnosis.candidates import Candidate, candidates
from calib.diagnosis.cross_validation import Alternative, CrossValidation, _folds
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
    fold, data = _folds(stage.data.poses, by_time), stage.data
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
    crossed = CrossValidation(stage, fit)
    for member, rest in ((right, wrong), (wrong, right)):
        found = crossed.ledger([member.effect], by_time)
        assert found.rms_with == pytest.approx(both, rel=0.02)
        assert found.rms_without == pytest.approx(predicted(stage, [rest], by_time), rel=0.02)
    assert crossed.ledger([right.effect], by_time).earns
    assert not crossed.ledger([wrong.effect], by_time).earns


def test_beside_a_camera_lengths_alone_are_told_in_mm(tmp_path: Path) -> None:
    """A pixel is no metre: the errors are those of the tracker's points."""
    from tests.camera_days import SETUPS, Truth, kr270_day

    off = np.array([0.0, 0.0, 8e-4, 0.0, 0.0, 0.0])
    setup = SETUPS["kr270"]
    cell, data = kr270_day(tmp_path, setup, Truth(off), 24, effects='"base", "tool"')
    stage, suspects = asked(cell, data)
    right = next(c for c in suspects if c.key == "joint_offset:A3")
    found = CrossValidation(stage, stage.fit([right.effect])).ledger([right.effect], False)
    assert found.rms_without == pytest.approx(predicted(stage, [], False), rel=0.1)
    assert found.rms_with == pytest.approx(predicted(stage, [right], False), rel=0.05)
    assert found.rms_with < 1e-4 < found.rms_without < 3e-3


def test_what_is_chosen_anew_is_chosen_without_the_fold() -> None:
    """Against refits: in each fold the best of the choices by the other poses alone."""
    cell, data, _ = measured("backlash:A3", [6e-5])
    stage, suspects = asked(cell, data)
    linear = stage.about(stage.fit([]), [c.effect for c in suspects])
    offered = [c for c in suspects if c.key in ("backlash:A3", "backlash:A4", "backlash:A5")]
    fit = linear.fit([offered[0].effect])
    rows = [fit.observation.rows(linear.model.of(c.effect)) for c in offered]
    choices = [
        Alternative(c.key, X, np.full(X.shape[-1], 1e3)) for c, X in zip(offered, rows, strict=True)
    ]
    found = CrossValidation(linear, fit).ledger([offered[0].effect], False, choices)
    fold = _folds(data.poses, by_time=False)
    expected = 0.0
    for f in range(int(fold.max()) + 1):
        apart = replace(linear, dropped=fold == f)
        fits = [apart.fit([c.effect]) for c in offered]
        best = min(fits, key=lambda own: float((own.r**2).sum()))
        off = linear.observation(best.model, fit.weight).linearise(best.values)[0]
        expected += float((off[fold == f] ** 2).sum())
    assert found.with_it == pytest.approx(expected, rel=1e-6)
    assert found.again == 1.0


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
    found = CrossValidation(stage, stage.fit([right.effect])).ledger([right.effect], by_time)
    assert found.rms_with == pytest.approx(predicted(stage, [right], by_time), rel=0.02)
    assert found.rms_without == pytest.approx(predicted(stage, [], by_time), rel=0.02)
    assert found.rms_with > 1e-5
    assert found.earns
