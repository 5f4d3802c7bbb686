"""No words of a figure lie upon others, none leave it, and each figure says what is seen."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest

from studies.document import pictures_of
from studies.kinds import tell
from studies.plots.errors import by_pose
from studies.plots.style import Picture, sheet, styled, svg_text
from studies.research.picture import picture as of_the_readme
from studies.results.read import read
from tests.studies.drawn_words import collisions


def pictures(path: Path) -> Iterator[Picture]:
    return pictures_of(tell(read(path)))


def check(picture: Picture) -> None:
    assert collisions(picture) == [], picture.name
    assert len(picture.title.split()) >= 3, f"{picture.name} does not say what is seen"
    assert picture.caption.endswith(".")
    assert "\n" not in "".join(picture.header)
    assert all(len(row) == len(picture.header) for row in picture.rows)
    svg = svg_text(picture)
    assert f"<dc:title>{escape(picture.title)}</dc:title>" in svg
    assert "<dc:date>" not in svg, "the same bytes another day"
    assert ">nan<" not in svg.lower()
    assert min(float(size) for size in re.findall(r"font-size: ([\d.]+)px", svg)) >= 9.0


@pytest.mark.parametrize("name", ["identify", "diagnose", "design", "compare"])
def test_of_the_demonstration(name: str, demo_folder: Path) -> None:
    for picture in pictures(demo_folder / f"{name}.json"):
        check(picture)


def test_of_the_readme(demo_folder: Path) -> None:
    assert collisions(of_the_readme(demo_folder)) == []


@styled
def _crowded() -> Picture:
    figure = sheet(4.0, 3.0)
    panel = figure.subplots()
    panel.set_xticks([0.500, 0.501, 1.0], ["0.500", "0.501", "1"])
    figure.text(0.95, 0.5, "beyond the sheet").set_in_layout(False)
    return Picture("crowded", "Words that collide", "", figure, (), ())


def test_words_that_collide_are_found() -> None:
    found = collisions(_crowded())
    assert ("0.500", "0.501") in found
    assert ("beyond the sheet", "the edge") in found


def test_a_file_holds_the_title_and_a_page_does_not() -> None:
    errors = np.array([1e-3, 2e-3])
    picture = by_pose(("a", "b"), errors, 0.1 * errors, np.zeros(2, dtype=bool), 1e-5)
    plain = svg_text(picture)
    headed = svg_text(picture, headed=True)
    assert "</text>" in plain
    drawn = [text.count(">Error of each pose: ") for text in (plain, headed)]
    assert drawn[1] == drawn[0] + 1, "a file shows what a page says beside the figure"
    assert svg_text(picture) == plain, "drawing a file changed the figure"


def test_errors_by_pose_show_before_and_after() -> None:
    """Root mean squares of the table, by hand."""
    heldout = np.array([False, False, True])
    before, after = np.array([3e-3, 4e-3, 5e-3]), np.array([1e-5, 2e-5, 3e-5])
    picture = by_pose(("a", "b", "c"), before, after, heldout, 1e-5)
    assert picture.rows[2] == ("c", pytest.approx(5.0), pytest.approx(0.03), "held out")
    assert "5.0 mm before, 0.030 mm after" in picture.title
    fitted = by_pose(("a", "b"), before[:2], after[:2], heldout[:2], 1e-5)
    was = math.sqrt((9.0 + 16.0) / 2.0)
    assert f"{was:.1f} mm before" in fitted.title
    assert "fitted poses" in fitted.title
