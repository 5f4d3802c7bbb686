"""Whatever speaks against a name makes it less likely, and nothing makes it certain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib.diagnosis.probability import Evidence
from calib.effects import catalogue
from calib.effects.protocol import Context
from calib.model.build import place_effect
from tests.helpers import random_context, random_robot


@pytest.fixture(scope="module")
def context() -> Context:
    rng = np.random.default_rng(1)
    return random_context(rng, random_robot(rng, 3))


def plain(context: Context, kind: str = "transmission_harmonic") -> Evidence:
    where = catalogue()[kind].places(context)[0]
    return Evidence(place_effect(kind, where, context), 1.0, 0.0, 1.0, company=False)


@pytest.mark.parametrize(
    "against",
    [{"form_p": 1e-3}, {"curve_ratio": 1.2}, {"again": 0.8}, {"company": True}],
)
def test_what_speaks_against_it_lowers_it(context: Context, against: dict[str, Any]) -> None:
    own = plain(context)
    assert 0.9 < own.probability < 1.0
    assert replace(own, **against).probability < own.probability


def test_a_cause_that_follows_what_it_likes_is_less_likely(context: Context) -> None:
    assert plain(context, "stiffness_vs_angle").probability < 0.8
