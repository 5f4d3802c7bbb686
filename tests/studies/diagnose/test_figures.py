"""What the figures of a diagnosis hold are its numbers, and its entries those of spectra."""

from __future__ import annotations

import numpy as np
import pytest

from calib import Cell
from calib.diagnosis import Diagnosis
from studies import figures
from studies.render import markdown
from studies.results.base import envelope
from studies.results.diagnose import DiagnoseResult, SpectrumLines, aliases_of
from tests.calib.test_error_curve import HALF, found
from tests.calib.test_recovered import arm, session
from tests.calib.test_recovered import read as instrument_reads
from tests.calib.test_spectra import mirrored, on_grid, spectra_at, with_ripple


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return found("backlash:A3", (HALF,))[0]


@pytest.mark.long
def test_steps_and_curve_are_those_of_the_diagnosis(diagnosis: Diagnosis, kr270: Cell) -> None:
    made = envelope("cell", [])
    result = DiagnoseResult.of(diagnosis, kr270, made)
    gap, steps = result.gap, result.steps
    assert steps is not None
    assert steps.added == ("backlash:A3",)
    assert steps.of == "held-out poses"
    assert steps.rms_mm == pytest.approx((gap.heldout_before_mm, gap.heldout_after_mm))
    (curve,) = result.curves
    assert curve.absorbed
    assert "such as a constant part" in markdown(result, page=True, draw=lambda *own: own[2])
    (panel,) = curve.panels
    own, sign = (np.array(values, dtype=float) for values in (panel.effect, curve.variable))
    np.testing.assert_allclose(sign, diagnosis.data.poses.approach[:, 2])  # type: ignore[index]
    half = 0.5 * (own[sign > 0].mean() - own[sign < 0].mean())
    assert half == pytest.approx(1e6 * diagnosis.causes[0].values[0], rel=1e-6)
    figure = figures.located_curve(result, curve)
    assert [axes.get_ylabel() for axes in figure.axes] == ["error of A3 [urad]"]
    assert result.model_validate_json(result.to_json()) == result


def test_entries_say_aliases() -> None:
    cell, rng = arm(), np.random.default_rng(9)
    poses = on_grid(session(cell, rng, 90), 1)
    data = instrument_reads(cell, poses, rng, with_ripple(poses, 1, 100.0, 6e-5))
    seen = list(spectra_at(cell, data, [("j2", 100.0)]).values())
    for spectrum in seen:
        assert len(SpectrumLines.of(spectrum).lines) == len(spectrum.lines)
    (cycles,) = (c for c, _ in seen[1].named)
    assert aliases_of("j1", cycles, seen) == ()
    np.testing.assert_allclose(np.sort(aliases_of("j2", cycles, seen)), mirrored(cycles), atol=0.1)
