"""A cause that is there comes again in every half; what stands beside it follows dense algebra."""

from __future__ import annotations

import numpy as np

from calib import Diagnosis
from calib.diagnosis.equivalence import classes
from calib.diagnosis.stability import _beside, _halves, stability


def test_halves_complete_each_other() -> None:
    for first, second in zip(_halves(21)[::2], _halves(21)[1::2], strict=True):
        assert (first ^ second).all()
        assert first.sum() == 10


def test_a_cause_that_is_there_comes_again(found_lost_motion: Diagnosis) -> None:
    found = found_lost_motion
    named, _ = classes(found.stage, found.outcome)
    assert stability(found.outcome.judged, named) == {"backlash:elbow": 1.0}


def test_what_is_beside_held_columns_is_that_of_least_squares(rng: np.random.Generator) -> None:
    A, X, r = rng.normal(size=(80, 4)), rng.normal(size=(80, 3)), rng.normal(size=80)
    rows, precision = np.column_stack([A, X, r]), np.array([0.0, 0.0, 2.0, 5.0])
    S, z = _beside(rows.T @ rows, np.arange(4), precision, np.arange(4, 8))
    held = np.concatenate([A, np.diag(np.sqrt(precision))])
    flat = np.concatenate([np.column_stack([X, r]), np.zeros((4, 4))])
    left = flat - held @ np.linalg.lstsq(held, flat, rcond=None)[0]
    np.testing.assert_allclose(S, left[:, :3].T @ left[:, :3], rtol=1e-6)
    np.testing.assert_allclose(z, left[:, :3].T @ left[:, 3], rtol=1e-6, atol=1e-6)
