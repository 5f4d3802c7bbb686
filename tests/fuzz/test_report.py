"""What the fuzzer found in reports, and that its check of a page can fail."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calib.errors import InputError
from studies.report.page import report_page
from studies.research.fuzz_days.play import one_day
from tests.fuzz.report import check_harmless
from tests.fuzz.small_cell import put_small_cell, small_results

Change = Callable[[dict[str, Any]], object]


def _strangers(fields: dict[str, Any]) -> None:
    """Two thousand points, each of its own pose and its own marker: gigabytes as a table."""
    row = fields["residuals"][0]
    fields["residuals"] = [{**row, "pose": f"p{i}", "marker": f"m{i}"} for i in range(2000)]


def _falling(result: dict[str, Any], first: float) -> dict[str, Any]:
    """A diagnosis whose error falls from a first figure [mm] with one effect."""
    place = {"where": "X1", "depends_on": "approach:X1", "share_of_gap": 0.9}
    result.update(verdict="unknown", located=[place])
    result["steps"].update(added=["backlash:X1"], rms_mm=[first, 0.02])
    return result


DAMAGED: dict[str, tuple[str, Change, str]] = {
    "NaN": ("enough", lambda r: r.update(goal_mm=float("nan")), "goal_mm: should be a finite"),
    "huge": ("enough", lambda r: r.update(goal_mm=10**400), "goal_mm: "),
    "no joint": (
        "designed",
        lambda r: r["poses"][0]["joints_mm"].clear(),
        "not all the same joints",
    ),
    "far joint": (
        "designed",
        lambda r: r["poses"][0]["joints_mm"].update(X1=1e20),
        "no plausible size",
    ),
    "no points": (
        "compared",
        lambda r: r["plans"][0]["approaches"].clear(),
        r"plans\[0\].approaches: ",
    ),
    "no floor": (
        "diagnosed",
        lambda r: _falling(r, 0.03)["gap"].update(floor_mm=0.0),
        "gap.floor_mm: ",
    ),
    "below zero": ("diagnosed", lambda r: _falling(r, -1.0), r"steps.rms_mm\[0\]: "),
    "strangers": ("identified", _strangers, "residuals have too many poses and markers"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fault", DAMAGED)
def test_damaged_result_ends_in_one_line(tmp_path: Path, fault: str) -> None:
    name, change, message = DAMAGED[fault]
    fields = copy.deepcopy(small_results()[name])
    change(fields)
    put_small_cell(tmp_path)
    (tmp_path / "result.json").write_text(json.dumps(fields))
    with pytest.raises(InputError, match=message):
        report_page([tmp_path / "result.json"], None, {})


@pytest.mark.parametrize(
    "harm",
    [
        "<img src='data:image/png;base64,'>",
        "<p onclick='x'>",
        "<a href='javascript:x'>",
        "<p style='background: url(http://x)'>",
        "<script>1</script>" * 3,
        "<script type='module'>1</script>",
    ],
)
def test_harm_is_seen(harm: str) -> None:
    own = "<script></script><script></script><a href='#x'>x</a>"
    check_harmless(own)
    with pytest.raises(AssertionError):
        check_harmless(own + harm)


# -- Days at the edge of sense, a few of them: all of it is ``python -m studies.research.fuzz_days``


QUICK = (2, 3, 5, 7, 8, 10, 13, 17, 21, 24)
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
