"""Every tuning's score at once is that of its own columns; what is there is selected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.diagnosis.stage import Stage
from calib.effects.tuned import Tuned
from calib.identification.scan import carried, falls, times
from calib.inference.evidence import score_test
from calib.model.build import context_of, place_effect
from calib.scatter import Variances
from tests.calib.diagnosis.test_diagnose import measured
from tests.helpers import stage_of


def stage_of_a_day() -> tuple[calib.Cell, Stage]:
    """Free and loaded readings of each configuration."""
    cell, data, _ = measured("backlash:A3", [2e-4])
    return cell, stage_of(cell, data)


@pytest.mark.parametrize("scatters", [False, True])
@pytest.mark.parametrize("name", ["gear_ripple:A2", "warm_up:base", "step:A3"])
def test_a_scan_is_the_score_of_every_tuning(name: str, scatters: bool) -> None:
    cell, stage = stage_of_a_day()
    fit = stage.fit(())
    if scatters:
        n = cell.robot.dof
        known = Variances(1.2, np.full(n + 2, 1e-10), np.full(n + 2, 4e-10))
        scattered = replace(fit.observation, scatter=stage.scatter.at(known))
        fit = replace(fit, observation=scattered)
    effect = place_effect(*name.split(":"), context_of(cell, stage.data.poses))
    assert isinstance(effect, Tuned)
    whole, values = fit.model.extended(fit.values, [effect.carrier])
    _, J = whole.jacobian(values, stage.data.poses)
    b = len(effect.carrier.parameters)
    carrier = fit.observation.rows(J[..., -b:])
    tunings = effect.grid(stage.data.poses)[::7]
    functions = effect.functions(stage.data.poses, tunings)
    limits = np.array([p.limit for p in effect.amplitudes])
    found = falls(carried(fit.linear.complement, carrier), functions, limits)
    r, J = fit.linear.independent
    N = J @ fit.span
    for fall, own in zip(found, functions, strict=True):
        rows = times(carrier, own)
        X = (rows if fit.mixing is None else fit.mixing(rows)).reshape(-1, rows.shape[-1])
        left = X - N @ np.linalg.lstsq(N, X, rcond=None)[0]
        lengths = np.linalg.norm(X, axis=0)
        expected, _ = score_test(left.T @ left, left.T @ r, lengths, limits)
        assert fall == pytest.approx(float(expected), rel=1e-6, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "values", "tuning", "within"),
    [
        ("gear_ripple:A3", [200.0, 6e-5, -5e-5], 200.0, 0.5),
        ("warm_up:base", [1800.0, 3e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4], 1800.0, 600.0),
        ("step:marker:m1", [2000.0, 1e-4, 0.0, -1e-4], 2000.0, 120.0),
    ],
)
def test_what_has_a_tuning_is_found_with_it(
    effect: str, values: list[float], tuning: float, within: float
) -> None:
    cell, data, held = measured(effect, values)
    found = calib.diagnose(cell, data, heldout=held)
    (cause,) = found.causes
    keys = [c.key for c, _ in cause.named.members]
    assert effect in keys
    # Readings cannot tell whether the base warms, or the instrument.
    assert keys[0] == effect or effect == "warm_up:base"
    assert abs(cause.values[0] - tuning) < within
    if keys[0] == effect:
        error = (cause.values - np.array(values))[1:] / cause.std[1:]
        assert np.abs(error).max() < 4.0
    assert found.gap.heldout_after is not None
    assert found.gap.heldout_before is not None
    assert found.gap.heldout_after < found.gap.heldout_before
