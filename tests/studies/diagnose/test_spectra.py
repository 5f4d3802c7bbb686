"""Spectra in the result: every peak stays, and what a ripple's cycles might be as well is said."""

from __future__ import annotations

import numpy as np
import pytest

from studies.diagnose.make import aliases_of, spectrum_entry
from tests.calib.diagnosis.test_spectra import mirrored, on_grid, spectra_at, with_ripple
from tests.calib.identification.test_identify_tunings import arm, read, session


def test_entries_keep_every_peak_and_say_aliases() -> None:
    cell, rng = arm(), np.random.default_rng(9)
    poses = on_grid(session(cell, rng, 90), 1)
    data = read(cell, poses, rng, with_ripple(poses, 1, 100.0, 6e-5))
    found = list(spectra_at(cell, data, [("j2", 100.0)]).values())
    for spectrum in found:
        entry = spectrum_entry(spectrum)
        assert len(entry.model_dump_json()) < 200_000 / 6
        assert max(entry.fall) == pytest.approx(spectrum.fall.max(), abs=0.01)
        assert (np.diff(entry.cycles_1_turn) > 0.0).all()
    (cycles,) = (c for c, _ in found[1].named)
    assert aliases_of("j1", cycles, found) == ()
    np.testing.assert_allclose(np.sort(aliases_of("j2", cycles, found)), mirrored(cycles), atol=0.1)
