"""Rounding and the order of rows are no evidence: they change no diagnosis."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.research.benchmarks.invariance import CHANGES, one_day


@pytest.mark.parametrize("index", [3, pytest.param(12, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["first", pytest.param("real_arms", marks=pytest.mark.long)])
def test_drawn_days(kind: str, index: int) -> None:
    day = one_day(kind, index, seed=0)
    assert all(day[change] == day["as it is"] for change in CHANGES)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "index"), [("ur10_leica_b", 1), ("meca500_right80", 0)])
def test_real_days(data: Path, kind: str, index: int) -> None:
    """The UR10's had other causes by rounding, the Meca's another verdict by the order of its rows."""
    assert data.is_dir()
    test_drawn_days(kind, index)
