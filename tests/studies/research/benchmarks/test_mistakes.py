"""The benchmark of people's mistakes: each gets its line, and healthy days get none."""

from __future__ import annotations

import pytest

from studies.research.benchmarks.mistakes.__main__ import row_of
from studies.research.benchmarks.mistakes.healthy import drawn
from studies.research.benchmarks.mistakes.table import MISTAKES

QUICK = {
    "tabs",
    "a jaw beside a fixed frame (as so101)",
    "meshes absent, programmed",
    "a topic misspelt",
}


def test_mistakes_have_names_of_their_own() -> None:
    names = [own.did for own in MISTAKES]
    assert len(names) == len(set(names)) >= 30


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if m.did in QUICK], ids=lambda m: m.did)
def test_each_gets_its_line(mistake) -> None:  # type: ignore[no-untyped-def]
    row = row_of(mistake)
    assert row["place"], row["line"]
    assert row["remedy"], row["line"]
    assert row["ended"], row["status"]


@pytest.mark.sampled
@pytest.mark.parametrize("index", range(6))
def test_healthy_days_are_called_nothing(index: int) -> None:
    assert drawn(index, seed=1)[1] == []
