"""Words of a figure as they are drawn: where they stand, and which collide."""

from __future__ import annotations

from itertools import combinations
from unittest.mock import patch

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

_INSET = 1.0  # pixels at 100 dots per inch: what touches by rounding does not collide
_BESIDE = 1.0  # pixels that words side by side keep apart, else they read as one


def words_of(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn, with its box in pixels at 100 dots per inch."""
    found: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def recorded(self: Text, renderer: object) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            found.append((self.get_text(), self.get_window_extent(renderer)))

    figure.set_dpi(100)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # finds the places
    with patch.object(Text, "draw", recorded):
        canvas.draw()
    return found


def collisions(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts that overlap, and texts that leave the figure."""
    words = words_of(figure)
    width, height = (100.0 * size for size in figure.get_size_inches())
    beyond = [
        (text, "the edge")
        for text, box in words
        if min(box.x0, box.y0) < -_INSET or box.x1 > width + _INSET or box.y1 > height + _INSET
    ]
    return beyond + [
        (one, other)
        for (one, a), (other, b) in combinations(words, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > -_BESIDE
        and min(a.y1, b.y1) - max(a.y0, b.y0) > _INSET
    ]
