"""The score test and what a plan can see, on plain linear problems."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.stats import chi2, f

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.detection_limit import detectable, entry_limit
from calib.diagnosis.screen import Field, ScoreRequest, field, score, scored
from calib.effects.protocol import Effect
from calib.evidence import chance_above, ratio_above
from calib.identification.noise_level import replicate_factor
from tests.calib.diagnosis.test_diagnose import measured

N, X = np.split(np.random.default_rng(0).normal(size=(300, 13)), [8], axis=1)


def test_score_is_the_fall_of_the_sum_of_squares(rng: np.random.Generator) -> None:
    r = rng.normal(size=300)
    found = score(field(N, X, r), np.arange(5))
    both = np.column_stack([N, X])
    alone = r - N @ np.linalg.lstsq(N, r, rcond=None)[0]
    together = r - both @ np.linalg.lstsq(both, r, rcond=None)[0]
    assert found.fall == pytest.approx(alone @ alone - together @ together)
    assert found.price == pytest.approx(5 * np.log(300))


@pytest.mark.long
def test_evidence_of_a_curve_is_a_ratio_of_marginal_likelihoods(rng: np.random.Generator) -> None:
    """Against the dense normal density of the projected residual, over a fine grid of amplitudes."""
    spread = np.exp(-np.abs(np.subtract.outer(np.arange(5), np.arange(5))) / 2.0)
    r = rng.normal(size=300) + X @ (0.2 * np.linalg.cholesky(spread) @ rng.normal(size=5))
    view = field(N, X, r)
    assert not view.noise_refuted
    best = 0.0
    for t in np.geomspace(1e-4, 10.0, 400):
        cov = np.eye(300) + t * view.X @ spread @ view.X.T
        _, logdet = np.linalg.slogdet(cov)
        best = max(best, view.r @ view.r - view.r @ np.linalg.solve(cov, view.r) - logdet)
    assert score(view, np.arange(5), spread).evidence == pytest.approx(best, rel=0.01)


def test_a_curve_comes_by_chance_no_more_often_than_it_says(rng: np.random.Generator) -> None:
    spread = np.eye(5)
    for sigma in (1.0, 2.0):
        draws = (field(N, X, sigma * rng.normal(size=300)) for _ in range(400))
        p = np.array([score(view, np.arange(5), spread).p for view in draws])
        assert np.mean(p < 0.2) <= 0.25


def test_p_values_are_uniform_where_nothing_is_missing(rng: np.random.Generator) -> None:
    for sigma in (1.0, 2.0):  # with the noise as stated, and where it is refuted
        p = []
        for _ in range(400):
            r = sigma * rng.normal(size=300) + N @ rng.normal(size=8)
            p.append(score(field(N, X, r), np.arange(2)).p)
        assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.045)


@pytest.mark.parametrize("k", [1, 4])
def test_an_effect_of_the_size_said_to_be_detectable_is_detected(
    k: int, rng: np.random.Generator
) -> None:
    view, asked = field(N, X, np.zeros(300)), 200
    size = detectable(view, np.arange(k), asked, 0.01).smallest[0]
    hits = [
        score(field(N, X, rng.normal(size=300) + X[:, 0] * size), np.arange(k)).fall
        > entry_limit(k, 300, asked, 0.01)
        for _ in range(300)
    ]
    assert np.mean(hits) == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_many_at_once_are_scored_as_each_alone(sigma: float, rng: np.random.Generator) -> None:
    """Of all kinds and sizes, and one of which nothing can be seen in between."""
    whole = np.column_stack([X, N[:, :2]])
    view = field(N, whole, sigma * rng.normal(size=300) + X[:, 3])
    asked = [
        ScoreRequest(np.array([3])),
        ScoreRequest(np.array([5, 6]), limits=np.array([1.0, 2.0])),
        ScoreRequest(np.array([0, 3]), limits=np.array([0.1, 3.0])),
        ScoreRequest(np.array([2, 3, 4]), spread=np.eye(3)),
        ScoreRequest(np.array([1])),
        ScoreRequest(np.arange(5), limits=np.full(5, 9.0), eliminate=True),
        ScoreRequest(np.array([0, 1, 2]), spread=0.1 * np.eye(3)),
    ]
    for one, found in zip(asked, scored(view, asked), strict=True):
        fresh = field(N, whole, view.r)
        alone = score(fresh, one.columns, one.spread, one.limits, one.eliminate)
        assert found.fall == pytest.approx(alone.fall, rel=1e-9)
        assert found.p == pytest.approx(alone.p, rel=1e-9)
    fall = [found.fall for found in scored(view, asked)]
    r = view.r - N @ np.linalg.lstsq(N, view.r, rcond=None)[0]
    for i, j in ((0, 3), (4, 1)):
        x = X[:, j] - N @ np.linalg.lstsq(N, X[:, j], rcond=None)[0]
        assert fall[i] == pytest.approx(float(x @ r) ** 2 / float(x @ x))
    assert fall[1] == 0.0


def test_what_the_model_contains_is_invisible(rng: np.random.Generator) -> None:
    inside = N @ rng.normal(size=(8, 2))
    view = field(N, inside, rng.normal(size=300))
    assert score(view, np.arange(2)).fall == 0.0
    assert score(view, np.arange(2), np.eye(2)).fall == 0.0
    assert np.isinf(detectable(view, np.arange(2), 10, 0.01).smallest).all()


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


# -- Who leads, who stays, and how sure the verdict is of a name -----------------------------------


class _Suspect(Candidate):
    """A candidate without an effect: leaders are chosen by scores alone."""

    @property
    def key(self) -> str:
        return self.depends_on


NAMED, CURVE = (_Suspect(cast(Effect, None), name, str(name)) for name in (True, False))


def test_a_gross_error_among_the_repeats_is_not_the_noise() -> None:
    cell, data, _ = measured("", [], seed=4, twice=12)
    weights = np.broadcast_to(np.eye(3) / cell.noise.across, (*data.seen.shape, 3, 3))
    assert replicate_factor(data, weights) == pytest.approx(1.0, abs=0.35)
    assert replicate_factor(data, 1.6 * weights) == pytest.approx(1.6, rel=0.3)
    points = data.points.copy()
    points[3] += 50.0 * cell.noise.across
    assert replicate_factor(replace(data, readings=points), weights) == pytest.approx(1.0, abs=0.35)


# -- Chances of weighted sums of squares, against chi-square, F and drawn ones ---------------------


@pytest.mark.parametrize("k", [1, 2, 4, 12, 60])
def test_equal_weights_are_chi_square(k: int) -> None:
    for p in (0.9, 0.5, 0.1, 0.03, 1e-3, 1e-10):
        found = chance_above(np.full(k, 0.3), 0.3 * float(chi2.isf(p, k)))
        assert found == pytest.approx(p, rel=0.05 if k > 1 else 0.12)


@pytest.mark.parametrize(
    "weights", [[1.0, 0.5, 0.1, 0.02], [1.0, 1e-3, 1e-3], [1.0, 0.8, 0.7, -0.3, -0.4]]
)
def test_unequal_weights_against_drawn_sums(weights: list[float]) -> None:
    drawn = np.random.default_rng(0).normal(size=(400_000, len(weights))) ** 2 @ np.array(weights)
    for p in (0.8, 0.5, 0.1, 0.03, 0.005):
        found = chance_above(np.array(weights), float(np.quantile(drawn, 1.0 - p)))
        assert found == pytest.approx(p, rel=0.06)


def test_shares_of_equal_weights_are_an_F_ratio() -> None:
    k, dof = 4, 90
    for p in (0.5, 0.03, 1e-6):
        F = float(f.isf(p, k, dof - k))
        share = F * k / (dof - k + F * k)
        assert ratio_above(np.ones(k), dof, share * dof) == pytest.approx(p, rel=0.03)
