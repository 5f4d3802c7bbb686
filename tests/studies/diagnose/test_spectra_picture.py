"""The figure of all spectra: every line with what it means, and what is not told said in words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from studies.diagnose.record import SpectrumEntry, SpectrumLine
from studies.diagnose.spectra import families, spectra
from studies.plots.style import svg_text


def panel(joint: str, *cycles: float, repeats: float | None = None) -> SpectrumEntry:
    grid = np.arange(0.25, 450.0, 0.3)
    fall = np.random.default_rng(0).chisquare(2, grid.size)
    lines = []
    for height, c in zip((150.0, 80.0, 40.0), cycles, strict=False):
        fall[np.argmin(np.abs(grid - c))] = height
        lines.append(
            SpectrumLine(
                cycles=c,
                std=0.1,
                amplitude_urad=50.0,
                amplitude_std_urad=5.0,
                fall=height,
                ratios=(c / 2.0, c),
                aliases=() if repeats is None else (8.0, 28.0),
            )
        )
    return SpectrumEntry(
        joint=joint,
        cycles_1_turn=tuple(grid.tolist()),
        fall=tuple(fall.tolist()),
        false_alarm=27.0,
        width_1_turn=1.2,
        repeats_1_turn=repeats,
        lines=tuple(lines),
    )


def test_joints_of_one_gear_are_one_family() -> None:
    panels = [panel("A1", 240.0), panel("A2", 240.9, 33.0), panel("A3", 200.4), panel("A4", 100.0)]
    assert families(panels) == [{(0, 0), (1, 0)}, {(2, 0), (3, 0)}]
    apart = [panel("A1", 240.0), panel("A2", 242.0), panel("A3", 90.0, 45.0)]
    assert families(apart) == []  # two widths apart; and a joint by itself is no pair
    chained = [panel("A1", 50.0), panel("A2", 100.2), panel("A3", 200.1)]
    assert families(chained) == [{(0, 0), (1, 0), (2, 0)}]


@pytest.mark.long
def test_lines_are_named_and_of_a_family_alike() -> None:
    panels = [
        panel("A1", 240.0),
        panel("A2", 241.0, 30.0),
        panel("A3"),
        panel("A4", 100.0, repeats=36.0),
    ]
    picture = spectra(panels)
    axes = picture.figure.axes
    assert [a.get_title("left") for a in axes] == ["A1", "A2", "A3", "A4"]
    assert [t.get_text() for t in axes[0].texts] == ["240.0: ratio 120.0 or 240.0"]
    assert [t.get_text() for t in axes[3].texts] == ["100.0, or 2 others"]
    assert axes[3].get_title("right") == "steps of 10 deg: repeats every 36 cycles"
    stems = [[line.get_color() for line in a.lines if line.get_linewidth() == 1.6] for a in axes]
    assert stems[0] == stems[1][:1]
    assert stems[1][1] == stems[3][0] != stems[0][0]
    assert stems[2] == []
    words = [t.get_text() for t in picture.figure.legends[0].get_texts()]
    assert words == [
        "chance passes it in 1 figure of 100",
        "lines that A1, A2 share",
        "line of one joint",
    ]
    assert [row[:2] for row in picture.rows] == [
        ("A1", 240.0), ("A2", 241.0), ("A2", 30.0), ("A3", None), ("A4", 100.0)
    ]  # fmt: skip
    assert picture.rows[-1][-1] == "8.0, 28.0"
    assert picture.caption.count(".") == 1
    assert picture.caption.endswith(".")
    svg = svg_text(picture)
    assert min(float(s) for s in re.findall(r"font-size: ([\d.]+)px", svg)) >= 9.0


def test_words_do_not_meet() -> None:
    picture = spectra([panel("A1", 200.0, 210.0, 220.0)])
    (axes,) = picture.figure.axes
    picture.figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) >= 2
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    inside = axes.get_window_extent()
    assert all(inside.x0 <= box.x0 and box.x1 <= inside.x1 for box in boxes)
