"""Whatever speaks against a name makes it less likely, and nothing makes it certain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib.diagnosis.causes import NameEvidence
from studies.research.sealed.weights import chance, fitted

PLAIN = NameEvidence("transmission_harmonic:j2", 1.0, 0.0, 1.0, company=False)


@pytest.mark.parametrize(
    "against",
    [{"form_p": 1e-3}, {"curve_ratio": 1.2}, {"again": 0.8}, {"company": True}],
)
def test_what_speaks_against_it_lowers_it(against: dict[str, Any]) -> None:
    assert 0.9 < PLAIN.probability < 1.0
    assert replace(PLAIN, **against).probability < PLAIN.probability


def test_a_cause_that_follows_what_it_likes_is_less_likely() -> None:
    nearly = replace(PLAIN, curve_ratio=0.9)
    assert nearly.probability == PLAIN.probability
    assert replace(nearly, key="stiffness_vs_angle:j2").probability < 0.8
    assert replace(nearly, key="step:j2").probability < 0.9
    assert replace(nearly, key="step:base").probability == PLAIN.probability
    assert replace(PLAIN, key="step:j2").probability == PLAIN.probability


def test_weights_are_found_again() -> None:
    rng, truth = np.random.default_rng(3), np.array([1.0, -2.0, 0.5])
    A = np.column_stack([np.ones(4000), rng.normal(size=(4000, 2))])
    right = (rng.random(4000) < chance(A, truth)).astype(float)
    assert fitted(A, right, (0.0, 1.0, 1.0)) == pytest.approx(truth, abs=0.2)
