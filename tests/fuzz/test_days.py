"""Days at the edge of sense, a few of them: all of it is ``python -m studies.research.fuzz_days``."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.research.fuzz_days.play import one_day

QUICK = (2, 3, 4, 5, 7, 8, 9, 10, 12, 13, 14, 15, 17, 18, 19, 21, 22, 23, 24, 1)  # 1 is slow
FAILED = {
    1000: "a series of whole poses was taken for one of points",
    1003: "degrees of freedom beyond all bounds",
    1025: "a series of heights was taken for one of points",
    1036: "a budget of a body had the sizes of its corners",
    1082: "a marker's effect was asked of a model of the tip",
    1092: "a forecast of nothing uncertain",
    1106: "a plane of one line left the room",
    1208: "an outlier where the others leave nothing",
    1247: "compare asked of a body whether its corners span a plane",
    1332: "levels of an arm that moves no row",
    2000: "compare shook a body's rows as if they were points",
    2024: "two steps of no directions",
    2036: "an estimate of no directions",
    2045: "the next poses of a model that moves no target",
    2097: "the next poses beside a singular past",
}


def faults_of(seed: int, folder: Path) -> list[str]:
    _, calls = one_day(seed, folder)
    assert calls[0][1].status in (0, 2)
    return [f"{fault.kind}\n{fault.text}" for _, _, fault in calls if fault is not None]


@pytest.mark.sampled
@pytest.mark.parametrize("seed", QUICK)
def test_every_command_ends_as_it_should(seed: int, tmp_path: Path) -> None:
    assert not faults_of(seed, tmp_path)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", FAILED, ids=[FAILED[s].replace(" ", "-") for s in FAILED])
def test_days_that_failed_once(seed: int, tmp_path: Path) -> None:
    assert not faults_of(seed, tmp_path)
