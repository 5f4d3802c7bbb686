"""Criteria are information functions, all that the certificate rests on; one of the user's own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import ClassVar, Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import doe
from calib import Cell, plugins
from calib.errors import CalibError
from doe.criteria import catalogue
from doe.criteria.protocol import Question
from doe.criteria.trace import Trace
from tests.doe.problems import criteria, random_information, unpolished

P = 5
NAMES = list(criteria(np.random.default_rng(0), P))
SMOOTH = ["D", "Ds", "A", "c", "task", "E", "E of two"]
seeds = st.integers(0, 10_000)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(seed=seeds)
def test_values_and_gradients_are_those_of_an_information_function(name: str, seed: int) -> None:
    """Concave, homogeneous and growing; the gradient's plane lies above all and touches at home."""
    rng = np.random.default_rng(seed)
    criterion = criteria(rng, P)[name]
    A, B = (random_information(rng, P) for _ in range(2))
    a, b, mean, double, sum_ = criterion.value(np.array([A, B, 0.5 * (A + B), 2.0 * A, A + B]))
    assert mean >= 0.5 * (a + b) * (1.0 - 1e-9)
    np.testing.assert_allclose(double, 2.0 * a, rtol=1e-9)
    assert sum_ >= max(a, b) * (1.0 - 1e-9)
    G = criterion.gradient(A)
    assert np.linalg.eigvalsh(G)[0] >= -1e-12 * np.abs(G).max()
    others = np.array([random_information(rng, P) * rng.uniform(0.01, 10.0) for _ in range(20)])
    assert (criterion.value(others) <= (G * others).sum(axis=(1, 2)) * (1.0 + 1e-9)).all()
    # Members within a few per cent of the smallest share the default weight of the kinked criteria.
    tight = (G * A).sum() / a
    assert 1.0 - 1e-9 <= tight <= (1.0 + 1e-9 if name in SMOOTH else 1.1)


@pytest.mark.parametrize("name", SMOOTH)
def test_gradient_against_differences(name: str) -> None:
    rng = np.random.default_rng(3)
    criterion, h = criteria(rng, P)[name], 1e-5
    M = random_information(rng, P)
    G = criterion.gradient(M)
    for _ in range(4):
        D = random_information(rng, P) - random_information(rng, P)
        ends = criterion.value(M + h * np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * D)
        slope = ends @ [1.0, -8.0, 8.0, -1.0] / (12.0 * h)
        np.testing.assert_allclose((G * D).sum(), slope, rtol=1e-6, atol=1e-8 * abs(slope) + 1e-9)


@pytest.mark.parametrize("name", ["D", "A", "c", "task"])
def test_curvature_against_differences(name: str) -> None:
    """Slope and Hessian of the cost that the interior point method minimises."""
    rng = np.random.default_rng(4)
    criterion = criteria(rng, P)[name]
    columns = np.array([random_information(rng, P) for _ in range(4)])
    w = np.array([1.0, 0.5, 0.7, 0.2])

    def cost(weights: np.ndarray) -> float:
        M = np.tensordot(weights, columns, 1)
        value = float(criterion.value(M))
        at_w = float(criterion.value(np.tensordot(w, columns, 1)))
        return -P * np.log(value) if name == "D" else at_w / value

    slope, rows = criterion.curvature(np.tensordot(w, columns, 1), columns)
    H, h = rows @ rows.T, 1e-4
    for i in range(4):
        e = np.eye(4)[i] * h
        np.testing.assert_allclose(slope[i], (cost(w + e) - cost(w - e)) / (2 * h), rtol=1e-5)
        second = (cost(w + e) - 2 * cost(w) + cost(w - e)) / h**2
        np.testing.assert_allclose(H[i, i], second, rtol=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_unchanged_by_relabelling(name: str) -> None:
    """The coordinates y have no say: only parameters in their units have."""
    rng = np.random.default_rng(5)
    M, S = random_information(rng, P), rng.normal(size=(P, P))  # y = S y', so M' = S^T M S
    for change in (np.eye(P)[:, rng.permutation(P)], S):
        here, there = (criteria(np.random.default_rng(6), P, C)[name] for C in (None, change))
        np.testing.assert_allclose(there.value(change.T @ M @ change), here.value(M), rtol=1e-8)


@dataclass(frozen=True, eq=False)
class Relative(Trace):
    """Mean variance of the parameters, each in its plausible size."""

    name: ClassVar[str] = "relative"
    unit: ClassVar[str] = "trace of the covariance, parameters in plausible sizes"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.sized.T)


@pytest.fixture
def announced(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    entry = EntryPoint("relative", f"{__name__}:Relative", "posecal.criteria")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    catalogue.cache_clear()
    yield
    catalogue.cache_clear()


@pytest.mark.long
@pytest.mark.usefixtures("announced")
def test_a_plan_is_designed_and_proved_by_its_name(kr270: Cell) -> None:
    options = {"candidates": 250}
    own = unpolished(kr270, criterion="relative", **options)
    other = unpolished(kr270, criterion="D", **options)
    sizes = own.problem.model.sizes

    def relative(plan: doe.Design) -> float:
        return float(np.sum((plan.assessment.std / sizes) ** 2))

    assert own.value == pytest.approx(relative(own), rel=1e-6)
    assert own.bound <= own.value <= relative(other)
    assert own.efficiency == pytest.approx(own.bound / own.value)


@pytest.mark.usefixtures("announced")
def test_a_name_that_is_unknown_or_taken(kr270: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        CalibError, match=r"criterion: 'B' is unknown; known are task, .*, relative"
    ):
        doe.design(kr270, criterion="B", candidates=10)
    entry = EntryPoint("D", f"{__name__}:Relative", "posecal.criteria")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    catalogue.cache_clear()
    with pytest.raises(CalibError, match=r"criterion 'D' of .*: the name is taken"):
        catalogue()
