"""What is left out is predicted as a refit without it predicts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.candidates import candidates
from calib.diagnosis.earned import CrossValidation, _folds
from calib.diagnosis.stage import Stage
from calib.identification.initial import initial_values
from calib.identification.whitening import whitening
from calib.model.build import build
from calib.poses import Measurements
from tests.calib.diagnosis.test_diagnose import measured

pytestmark = pytest.mark.long


def stage_of(effect: str, values: list[float]) -> tuple[Stage, list]:
    cell, data, _ = measured(effect, values)
    model = build(cell, data.poses).model
    start = initial_values(model, data)
    weights = whitening(cell, model, start, data)
    stage = Stage(data, model, start, weights, np.zeros(len(data), dtype=bool), robust=False)
    return stage, candidates(cell, model, data)[0]


def predicted(stage: Stage, effects: list, by_time: bool) -> float:
    """3-D RMS at folds predicted by refits without them, m."""
    fold, data = _folds(stage.data.poses, by_time), stage.data
    squares = 0.0
    for f in range(int(fold.max()) + 1):
        fit = replace(stage, dropped=fold == f).fit([c.effect for c in effects])
        part: Measurements = data.take(fold == f)
        squares += float(((part.points - fit.model.predict(fit.values, part.poses)) ** 2).sum())
    return float(np.sqrt(squares / data.seen.sum()))


@pytest.mark.parametrize("by_time", [False, True])
def test_left_out_errors_are_those_of_refits(by_time: bool) -> None:
    stage, suspects = stage_of("backlash:A3", [2e-4])
    right = next(c for c in suspects if c.key == "backlash:A3")
    wrong = next(c for c in suspects if c.key == "transmission_harmonic:A5")
    fit = stage.fit([right.effect, wrong.effect])
    both = predicted(stage, [right, wrong], by_time)
    crossed = CrossValidation(stage, fit)
    for member, rest in ((right, wrong), (wrong, right)):
        found = crossed.ledger([member.effect], by_time)
        assert found.rms_with == pytest.approx(both, rel=0.02)
        assert found.rms_without == pytest.approx(predicted(stage, [rest], by_time), rel=0.02)
    assert crossed.ledger([right.effect], by_time).earns
    assert not crossed.ledger([wrong.effect], by_time).earns
