"""The figure of all spectra: every line with what it means, and what is not told said in words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from studies.diagnose.aliasing import aliasing_sentences
from studies.diagnose.pictures import _spectrum
from studies.plots.spectra import Mark, Panel, families, spectra
from studies.plots.style import svg_text


def panel(joint: str, *cycles: float, repeats: float | None = None) -> Panel:
    grid = np.arange(0.25, 450.0, 0.3)
    fall = np.random.default_rng(0).chisquare(2, grid.size)
    marks = []
    for height, c in zip((150.0, 80.0, 40.0), cycles, strict=False):
        fall[np.argmin(np.abs(grid - c))] = height
        marks.append(
            Mark(c, 0.1, 50.0, height, (c / 2.0, c), () if repeats is None else (8.0, 28.0))
        )
    return Panel(joint, grid, fall, 27.0, 1.2, repeats, tuple(marks))


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
    assert words == ["false alarm, 1 %", "lines that A1, A2 share", "line of one joint"]
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


def test_a_sentence_for_each_joint_that_a_grid_deceives() -> None:
    line = {
        "cycles": 100.0, "std": 0.1, "amplitude_urad": 50.0, "fall": 90.0, "ratios": [50.0, 100.0],
        "aliases": [8.0, 28.0, 44.0, 64.0, 80.0],
    }  # fmt: skip
    entry = {
        "joint": "A2", "cycles_1_turn": [1.0, 100.0], "fall": [1.0, 90.0], "false_alarm": 27.0,
        "width_1_turn": 1.0, "repeats_1_turn": 36.0, "lines": [line],
    }  # fmt: skip
    clear = {**entry, "joint": "A1", "repeats_1_turn": None, "lines": [{**line, "aliases": []}]}
    bare = {**entry, "joint": "A3", "lines": []}
    chance = {**entry, "joint": "A4", "repeats_1_turn": None}
    assert list(aliasing_sentences([clear, entry, bare, chance])) == [
        "A2 stands in steps of 10 deg, so that its line at 100.0 cycles a turn might as well be at "
        "8.0, 28.0, 44.0, 64.0 or 1 more; steps that are not equal would tell",
        "A3 stands in steps of 10 deg, so that c and 36 \N{MINUS SIGN} c cycles a turn are the same at "
        "these poses; steps that are not equal would tell",
        "A4: its line at 100.0 cycles a turn might as well be at 8.0, 28.0, 44.0, 64.0 or 1 more; "
        "steps that are not equal would tell",
    ]
    assert spectra([_spectrum(entry)]).rows[0][-1] == "8.0, 28.0, 44.0, 64.0, 80.0"
