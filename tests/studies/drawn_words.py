"""Words of a figure as they are drawn: where they stand, and which collide."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from unittest.mock import patch

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from studies.plots.style import RC, Picture, settle, title_above

_INSET = 1.0  # pixels at 100 dots per inch: what touches by rounding does not collide
_BESIDE = 2.0  # pixels that words side by side keep apart, else they read as one


@dataclass(frozen=True, eq=False)
class Word:
    """A text and the box that it fills, in pixels at 100 dots per inch."""

    text: str
    box: Bbox


def words_of(picture: Picture) -> list[Word]:
    """Every text that is drawn, ticks out of view left out, with the title as files have it."""
    found: list[Word] = []
    draw = Text.draw

    def recorded(self: Text, renderer: object) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            found.append(Word(self.get_text(), self.get_window_extent(renderer)))

    picture.figure.set_dpi(100)
    canvas = FigureCanvasAgg(picture.figure)
    with mpl.rc_context(RC):
        settle(picture.figure)
        with title_above(picture), patch.object(Text, "draw", recorded):
            canvas.draw()
    return found


def collisions(picture: Picture) -> list[tuple[str, str]]:
    """Pairs of texts that overlap, and texts that leave the figure."""
    words = words_of(picture)
    with title_above(picture) as sheet:
        width, height = sheet.width * 100.0, sheet.height * 100.0
    beyond = [
        (word.text, "the edge")
        for word in words
        if word.box.x0 < -_INSET
        or word.box.y0 < -_INSET
        or word.box.x1 > width + _INSET
        or word.box.y1 > height + _INSET
    ]
    return beyond + [
        (one.text, other.text)
        for one, other in combinations(words, 2)
        if min(one.box.x1, other.box.x1) - max(one.box.x0, other.box.x0) > -_BESIDE
        and min(one.box.y1, other.box.y1) - max(one.box.y0, other.box.y0) > _INSET
    ]
