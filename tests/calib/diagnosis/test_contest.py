"""Who leads, who stays, and how sure the verdict is of a name."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from calib.diagnosis.candidates import Candidate
from calib.effects.protocol import Effect
from calib.identification.noise_level import replicate_factor
from tests.calib.diagnosis.test_diagnose import measured


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
