"""Texts of results are no markup in a page, and the check of a page can fail."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from studies.report.page import report_page
from studies.research.fuzz_days.play import one_day
from tests.fuzz.report import check_harmless
from tests.fuzz.small_cell import put_small_cell, small_results

_SCRIPT = "</script><script>alert(1)</script><!--\"'><img src=x onerror=alert(2)>&lt;"


def _hostile(value: Any) -> Any:
    """Texts with a script behind them, wherever a user writes them."""
    if isinstance(value, dict):
        own = ("pose", "marker", "name", "reason", "cell", "targets", "instrument")
        return {
            k: v + _SCRIPT if k in own and isinstance(v, str) else _hostile(v)
            for k, v in value.items()
        }
    return [_hostile(own) for own in value] if isinstance(value, list) else value


def test_texts_of_results_do_nothing_in_a_page(tmp_path: Path) -> None:
    put_small_cell(tmp_path)
    paths = []
    for name in ("identified", "diagnosed", "designed", "compensated"):
        paths.append(tmp_path / f"{name}.json")
        paths[-1].write_text(json.dumps(_hostile(small_results()[name])))
    html, _ = report_page(paths, None, {})
    assert "alert(1)" in html
    check_harmless(html)


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
    own = "<script></script><a href='#x'>x</a>"
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
