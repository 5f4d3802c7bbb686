"""Rounding and the order of rows are no evidence: they change no diagnosis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from studies.research.bench import real_data
from studies.research.sealed.populations import POPULATIONS, families

SHARED, POSES = 40, 60  # days among which families are shared out, and poses of a real one


def answer(cell: Cell, data: Measurements) -> tuple[str, tuple[str, ...]]:
    """Verdict, and the causes in the order of their names."""
    found = calib.diagnose(cell, data)
    return found.verdict, tuple(sorted(c.named.candidate.key for c in found.causes))


def rounded(data: Measurements, rng: np.random.Generator) -> Measurements:
    """With 1e-15 m (or as much of another unit) of noise more."""
    noise = 1e-15 * rng.normal(size=data.readings.shape) * data.seen[..., None]
    return replace(data, readings=data.readings + noise)


def shuffled(data: Measurements, rng: np.random.Generator) -> Measurements:
    """With its rows in an order that their own columns of order and time contradict."""
    return data.take(rng.permutation(len(data)))


@pytest.mark.parametrize(
    ("kind", "index"),
    [("first", 3), *(pytest.param("real_arms", k, marks=pytest.mark.long) for k in (3, 12))],
)
def test_drawn_days(tmp_path: Path, kind: str, index: int) -> None:
    """Drawn as sealed cases are."""
    own = POPULATIONS[kind]
    family = families(np.random.default_rng(0), SHARED, own.shares)[index]
    case = tmp_path / "case"
    own.write(case, own.draw(np.random.default_rng([0, index]), family))
    cell = calib.load_cell(case / "cell.toml")
    data = calib.load_measurements(cell, case / "measurements.csv")
    found = answer(cell, data)
    for change in (rounded, shuffled):
        assert answer(cell, change(data, np.random.default_rng(index))) == found, change.__name__


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "index", "change"), [("ur10_leica_b", 1, rounded), ("meca500_right80", 0, shuffled)]
)
def test_real_days(data: Path, name: str, index: int, change) -> None:  # type: ignore[no-untyped-def]
    """The UR10's had other causes by rounding, the Meca's another verdict by the order of its rows."""
    cell, whole = real_data(name)
    kept = np.random.default_rng([0, index]).permutation(len(whole))[:POSES]
    day = whole.take(np.sort(kept))
    assert answer(cell, change(day, np.random.default_rng(index))) == answer(cell, day)
