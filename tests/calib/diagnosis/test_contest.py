"""Who leads, who stays, and how sure the verdict is of a name."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.equivalence import _members
from calib.diagnosis.screen import Score
from calib.diagnosis.stepwise import _leader
from calib.effects.protocol import Effect
from calib.identification.noise_level import replicate_factor
from tests.calib.diagnosis.test_diagnose import measured


class _Suspect(Candidate):
    """A candidate without an effect: leaders are chosen by scores alone."""

    @property
    def key(self) -> str:
        return self.depends_on


NAMED, CURVE = (_Suspect(cast(Effect, None), name, str(name)) for name in (True, False))
CURVED = Score(50.0, 48.0, 4.6, 1e-10)


def pays(found: Score) -> bool:
    """Of a hundred that are asked."""
    return found.gain > 2.0 * np.log(100) and found.p * 100 < 0.01


def test_a_name_leads_where_it_explains_nearly_as_much() -> None:
    scores = {NAMED.key: Score(46.0, 46.0, 6.8, 1e-11), CURVE.key: CURVED}
    assert _leader(scores, [NAMED, CURVE], pays) is NAMED
    scores[NAMED.key] = Score(40.0, 40.0, 6.8, 1e-9)
    assert _leader(scores, [NAMED, CURVE], pays) is CURVE


def test_a_name_that_does_not_pay_leads_nothing() -> None:
    """Six parameters for as much as a curve explains: none would enter, so the curve leads."""
    scores = {NAMED.key: Score(46.0, 46.0, 40.8, 1e-7), CURVE.key: CURVED}
    assert _leader(scores, [NAMED, CURVE], pays) is CURVE


def test_shares_of_a_class_follow_evidence_and_odds() -> None:
    twins = _members([(NAMED, 100.0), (CURVE, 100.0)])
    assert [p for _, p in twins] == pytest.approx([0.5, 0.5])
    alone = _members([(NAMED, 100.0), (CURVE, 130.0)])
    assert [(c, p) for c, p in alone] == [(NAMED, pytest.approx(1.0))]
    near = _members([(NAMED, 100.0), (CURVE, 106.0)])
    assert near[0][1] > 1.5 * near[1][1]
    # As likely by the readings, met once in twenty: the price of its odds stands in its evidence.
    seldom = replace(CURVE, odds=0.05)
    rare = _members([(NAMED, 100.0), (seldom, 100.0 + 2.0 * np.log(20.0))])
    assert rare[0][1] == pytest.approx(20.0 / 21.0)
    twin = replace(CURVE, twin_odds=0.05)
    alike = _members([(NAMED, 100.0), (twin, 100.0 + 2.0 * np.log(20.0))])
    assert alike[0][1] == pytest.approx(20.0 / 21.0)


def test_a_gross_error_among_the_repeats_is_not_the_noise() -> None:
    cell, data, _ = measured("", [], seed=4, twice=12)
    weights = np.broadcast_to(np.eye(3) / cell.noise.across, (*data.seen.shape, 3, 3))
    assert replicate_factor(data, weights) == pytest.approx(1.0, abs=0.35)
    assert replicate_factor(data, 1.6 * weights) == pytest.approx(1.6, rel=0.3)
    points = data.points.copy()
    points[3] += 50.0 * cell.noise.across
    assert replicate_factor(replace(data, readings=points), weights) == pytest.approx(1.0, abs=0.35)
