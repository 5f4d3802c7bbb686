"""Candidates as seen from a fit, one of its effects taken out again."""

from __future__ import annotations

import numpy as np
import pytest

from calib.diagnosis.candidates import candidates
from calib.diagnosis.screen import field
from calib.diagnosis.stage import Stage
from calib.diagnosis.view import lineup
from calib.identification.start import initial_values, whitening
from calib.model.build import build
from tests.calib.diagnosis.test_diagnose import measured

pytestmark = pytest.mark.long


def test_an_effect_taken_out_is_as_if_it_had_never_been_projected_out() -> None:
    """For a cause by name and for a curve, against a projection from scratch."""
    cell, data, _ = measured("backlash:A3", [3e-4])
    model = build(cell, data.poses).model
    start = initial_values(model, data)
    weights = whitening(cell, model, start, data)
    stage = Stage(data, model, start, weights, np.zeros(len(data), dtype=bool))
    suspects, _ = candidates(cell, model, data)
    named = next(c for c in suspects if c.key == "backlash:A3")
    curve = next(c for c in suspects if not c.named and c.depends_on == "q:A4")
    fit = stage.fit([named.effect, curve.effect])
    linear = stage.about(fit, [c.effect for c in suspects])
    active = (named, curve)
    seen, _ = lineup(linear, suspects).seen_from(linear, fit, active, fresh=True)
    r, J = fit.equations
    for member in (named, curve):
        own = fit.positions(member.effect)
        rest = fit.span[:, np.abs(fit.span[own]).sum(axis=0) == 0.0]
        X = np.zeros((len(r), seen.columns.shape[1]))
        X[: len(seen.columns)] = seen.columns
        scratch = field(J @ rest, X, r + J[:, own] @ fit.values[own])
        found = seen.without(member)
        for name, columns in seen.where.items():
            whole, theirs = found.take(columns), scratch.X[:, columns]
            ours = whole.X
            scale = max(float((theirs**2).max()), 1e-9) * len(r)
            np.testing.assert_allclose(
                ours.T @ ours, theirs.T @ theirs, atol=1e-6 * scale, err_msg=name
            )
            scale = np.sqrt(scale * scratch.cost)
            np.testing.assert_allclose(ours.T @ whole.r, theirs.T @ scratch.r, atol=1e-6 * scale)
        assert found.cost == pytest.approx(scratch.cost)
        assert found.dof == scratch.dof
