"""Families of parameters: those count, and stay, that pay; kinds that show at many joints."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.diagnosis.screen import Field, score
from tests.calib.diagnosis.test_diagnose import measured


def field_of(X: Array, r: Array) -> Field:
    return Field(X, r, np.linalg.norm(X, axis=0), len(r), len(r))


def test_of_many_parameters_those_count_that_pay() -> None:
    """Two of thirty columns carry the signal: best subset by hand against the score's choice."""
    rng = np.random.default_rng(3)
    X = rng.normal(size=(300, 30))
    r = X[:, [4, 17]] @ np.array([0.8, -0.6]) + rng.normal(size=300)
    field, columns, limits = field_of(X, r), np.arange(30), np.full(30, 100.0)
    whole, few = (score(field, columns, None, limits, eliminate) for eliminate in (False, True))
    alone = score(field, np.array([4, 17]), None, limits[:2])
    assert few.fall == pytest.approx(alone.fall, rel=1e-3)
    choices = 2.0 * np.log(30 * 29 / 2)
    assert few.price == pytest.approx(alone.price + choices, rel=1e-6)
    assert few.gain > whole.gain + 50.0


def test_nothing_is_chosen_from_noise() -> None:
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(100):
        X, r = rng.normal(size=(200, 20)), rng.normal(size=200)
        one = score(field_of(X, r), np.arange(20), None, np.full(20, 100.0), True)
        found += one.p < 0.05
    assert found <= 11  # 5 expected of a p value that holds; 11 once in a hundred


@pytest.mark.long
def test_friction_is_another_name_of_lost_motion() -> None:
    """Where the joint yields, friction winds it up by as much: the class says so."""
    cell, data, held = measured("backlash:A3", [3e-4])
    found = calib.diagnose(cell, data, heldout=held)
    assert found.verdict == "explained"
    (cause,) = found.causes
    names = [(c.key, p) for c, p in cause.named.members]
    assert [key for key, _ in names] == ["backlash:A3", "friction_windup:A3"]
    assert names[0][1] == pytest.approx(names[1][1])
    assert names[0][1] > 0.4


@pytest.mark.long
def test_lost_motion_at_every_joint_is_found_joint_by_joint() -> None:
    """Small at each, as no joint alone would be believed among all that is asked."""
    cell, data, held = measured("backlash", [3e-5] * 6)
    found = calib.diagnose(cell, data, heldout=held)
    named = {c.named.candidate.key for c in found.causes}
    assert len(named) >= 4
    assert named <= {f"backlash:A{k}" for k in range(1, 7)}
