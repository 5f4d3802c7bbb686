"""Curves without a name: their functions, their derivatives, and how they are held near zero."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import IntArray
from calib.diagnosis.candidates import candidates
from calib.diagnosis.columns import candidate_set
from calib.diagnosis.functions import neighbours
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.search import fitted
from calib.diagnosis.selection import start
from calib.diagnosis.stage import Fit
from calib.diagnosis.state import SelectedEffect
from calib.model.build import build
from tests.calib.diagnosis.test_diagnose import measured
from tests.helpers import stage_of


def test_neighbours_are_the_expectation_of_a_normal_field() -> None:
    """At the centres the coefficients themselves, elsewhere ordinary kriging with the same kernel."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(20, 3))
    field = neighbours(points)
    values = rng.normal(size=len(field.centres))
    np.testing.assert_allclose(field.at(field.centres) @ values, values, atol=1e-9)
    new = rng.normal(size=(4, 3))
    apart = np.linalg.norm(new[:, None] - field.centres, axis=-1)
    kriged = np.exp(-apart / 2.0) @ np.linalg.solve(field.spread, values)
    np.testing.assert_allclose(field.at(new) @ values, kriged, atol=1e-9)


@pytest.mark.parametrize("kind", ["TwistCurve", "MarkerCurve", "RangeCurve"])
def test_derivatives(kind: str) -> None:
    """Against central differences of the prediction."""
    cell, data, _ = measured("", [])
    base = build(cell, data.poses).model
    suspects, _ = candidates(cell, base, data)
    chosen = [c.effect for c in suspects if type(c.effect).__name__ == kind]
    model = base.with_effects((*base.effects, chosen[len(chosen) // 2]))
    values = model.sizes * np.random.default_rng(3).normal(size=len(model.parameters))
    _, J = model.jacobian(values, data.poses)
    for p in range(len(base.parameters), len(values)):
        step = np.zeros(len(values))
        step[p] = 1e-5
        ends = [model.predict(values + s * step, data.poses) for s in (0.5, -0.5)]
        np.testing.assert_allclose(J[..., p], (ends[0] - ends[1]) / 1e-5, atol=1e-6)


def test_a_curve_is_shrunk_by_as_much_as_the_data_leave_open() -> None:
    """A fit of pure noise keeps a curve far below what least squares would make of it."""
    cell, data, _ = measured("", [])
    stage = stage_of(cell, data)
    suspects, _ = candidates(cell, stage.model, data)
    curve = next(c for c in suspects if not c.named and c.depends_on.startswith("q:"))
    before = stage.fit()
    problem = RegressionProblem.of(stage, candidate_set(stage, before, suspects, ()), before.span)
    (member,) = (c for c in problem.fixed if c.candidate.key == curve.key)
    state = start(problem, ()).with_members((SelectedEffect(member, 1.0),))
    fit = fitted(stage, state, before)
    own = fit.positions(curve.effect)
    moved = np.linalg.norm(fit.J[..., own] @ fit.values[own])
    assert moved < 0.6 * _unheld(fit, own)


def _unheld(fit: Fit, own: IntArray) -> float:
    """Length of what the same columns do where nothing holds them back."""
    J = fit.J.reshape(-1, fit.J.shape[-1])
    free = np.linalg.lstsq(J, fit.r.ravel() + J @ fit.values, rcond=1e-9)[0]
    return float(np.linalg.norm(J[:, own] @ free[own]))
