"""Bars on a log scale."""

from __future__ import annotations

import re

import pytest

from studies.document import Raw
from studies.report.summary import Bar, bars


def widths(drawn: Raw) -> list[float]:
    return [float(width) for width in re.findall(r"width: ([\d.]+)%", drawn.html)]


def test_equal_ratios_are_equal_steps_and_the_noise_is_a_line() -> None:
    drawn = bars(
        [
            Bar("nominal", 4.0, "bad"),
            Bar("identified", 0.4, "good"),
            Bar("explained", 0.04, "good"),
            Bar("noise", 0.02, "floor"),
        ],
        "What is left.",
    )
    first, second, third, noise = widths(drawn)
    assert first == 100.0
    assert first - second == pytest.approx(second - third, abs=0.02)
    assert noise > 5.0, "the least is seen"
    assert re.findall(r'<i style="left: ([\d.]+)%', drawn.html) == [f"{noise:.2f}"] * 4
    assert re.findall(r">([\d.e+-]+)</span>", drawn.html) == ["0.1", "1"]
    assert re.findall(r'number">([\d.]+)', drawn.html) == ["4.00", "0.400", "0.0400", "0.0200"]
