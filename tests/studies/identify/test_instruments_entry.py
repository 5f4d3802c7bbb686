"""An instrument's figures in the JSON of an identification, flat and together."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from studies.identify.errors import OfInstrument


def test_figures_stand_flat_and_together_and_are_read_again() -> None:
    entry = OfInstrument(instrument="t1", unit="mm", nominal=2.0, fitted=0.5)
    written = entry.model_dump(mode="json")
    together = written.pop("rms")
    assert together == written
    assert OfInstrument.model_validate_json(entry.model_dump_json()) == entry


@pytest.mark.parametrize("raw", ["[]", "3", '"t1"'])
def test_what_is_no_entry_is_refused(raw: str) -> None:
    with pytest.raises(ValidationError):
        OfInstrument.model_validate_json(raw)
