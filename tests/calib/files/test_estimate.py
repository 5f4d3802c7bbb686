"""An estimate goes through its file whole, whatever its unit's numbers are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import Cell
from calib.errors import InputError
from calib.files.estimate import load_estimate
from calib.model.build import build
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from calib.scatter import Variances
from studies.results.estimate import Estimated

UNIX = 1_763_700_000.0  # s, November 2025


def spring(cell: Cell) -> Estimate:
    """Nothing but plausible sizes, a spring of 1e5 N/m among them, at times of today."""
    model = build(replace(cell, effects=("gravity_compensator:A2", "gravity_sag:A2"))).model
    none = ModelDiscrepancy(0.0, "fitted poses")
    return Estimate(model, 0.0 * model.sizes, np.diag(model.sizes**2), UNIX, none, ())


def written(known: Estimate, path: Path) -> Path:
    entry = Estimated.of(known).model_dump(by_alias=True)
    path.write_text(json.dumps({"command": "identify", "estimate": entry}))
    return path


def test_unix_times_and_variances_of_springs_are_read_back(kr270: Cell, tmp_path: Path) -> None:
    known = spring(kr270)
    assert known.covariance.max() == 1e10
    read = load_estimate(kr270, written(known, tmp_path / "result.json"))
    assert read.start == UNIX
    np.testing.assert_array_equal(read.covariance, known.covariance)


@pytest.mark.parametrize("start", ["NaN", "1e400", "1e13"])
def test_a_start_that_no_table_can_hold_is_damage(kr270: Cell, tmp_path: Path, start: str) -> None:
    path = written(spring(kr270), tmp_path / "result.json")
    text = path.read_text()
    path.write_text(text.replace(str(UNIX), start))
    assert path.read_text() != text
    with pytest.raises(InputError, match="estimate: is damaged"):
        load_estimate(kr270, path)


def test_the_arms_scatter_is_read_back_and_may_be_missing(kr270: Cell, tmp_path: Path) -> None:
    scatter = Variances(1.0, np.linspace(0.0, 1e-9, 8), np.linspace(2e-9, 0.0, 8))
    path = written(replace(spring(kr270), variances=scatter), tmp_path / "result.json")
    read = load_estimate(kr270, path).variances
    assert read is not None
    np.testing.assert_array_equal(read.approach, scatter.approach)
    np.testing.assert_array_equal(read.configuration, scatter.configuration)
    fields = json.loads(path.read_text())
    for damage in ([1e-9] * 3, [-1e-9] * 8, None):
        fields["estimate"]["scatter_SI"]["approach"] = damage
        path.write_text(json.dumps(fields))
        with pytest.raises(InputError, match="estimate: is damaged"):
            load_estimate(kr270, path)
    fields["estimate"]["scatter_SI"] = None
    path.write_text(json.dumps(fields))
    assert load_estimate(kr270, path).variances is None
