"""One style for all figures: colours of Okabe and Ito, each with a marker of its own, thin grids.

Text stays text in the SVG, and the same data give the same bytes.
"""

from __future__ import annotations

import functools
import io
import math
import re
import warnings
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

P = ParamSpec("P")
T = TypeVar("T")

BLUE, VERMILLION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
INK, SOFT, DIM, FAINT, PAPER = "#262626", "#6b6b6b", "#a3a3a3", "#d9d9d9", "#ffffff"
DASHED: Any = (0, (4, 2))
PANEL = 5.0
"""Inches: width of a figure of one panel, which a phone shows whole with its text still legible."""
_VECTOR = 1500  # points; a larger cloud becomes a picture within the SVG
_NAME = 40  # letters of a name beside an axis
_LETTER = 0.13  # inch, with the room about it
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial"],
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.markersize": 4.5,
    "text.color": INK,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "xtick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.color": SOFT,
    "ytick.labelcolor": INK,
    "svg.fonttype": "none",
}


class Look(NamedTuple):
    """How the points or lines of one name are drawn."""

    label: str
    color: str
    marker: str = ""
    linestyle: Any = ""


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function under the common style, whatever the user's is."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        import matplotlib as mpl

        with mpl.rc_context(_STYLE):
            return function(*args, **kwargs)

    return run


def panels(
    width: float, height: float, rows: int = 1, columns: int = 1, **more: Any
) -> tuple[Figure, list[Axes]]:
    """An empty figure, inches, and its panels, row by row; no global state."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **more).ravel().tolist()


def fixed(
    figure: Figure, sides: tuple[float, float, float, float], gaps: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Margins left, below, right, above and gaps across, down, inches: no layout measures words."""
    width, height = figure.get_size_inches()
    left, below, right, above = sides
    rows, columns = figure.axes[0].get_gridspec().get_geometry()  # type: ignore[union-attr]
    across = (width - left - right - (columns - 1) * gaps[0]) / columns
    down = (height - below - above - (rows - 1) * gaps[1]) / rows
    figure.set_layout_engine(None)
    figure.subplots_adjust(
        left / width, below / height, 1.0 - right / width, 1.0 - above / height,
        gaps[0] / across, gaps[1] / down
    )  # fmt: skip


def dots(panel: Axes, x: Any, y: Any, look: Look, **more: Any) -> None:
    """Points of one look; many become a picture within the SVG."""
    panel.plot(
        x, y, color=look.color, marker=look.marker, linestyle="", label=look.label,
        rasterized=len(x) > _VECTOR, **more
    )  # fmt: skip


def legend(figure: Figure) -> None:
    """One legend below all panels, every name once."""
    every = [panel.get_legend_handles_labels() for panel in figure.axes]
    named = {label: h for hs, labels in every for h, label in zip(hs, labels, strict=True)}
    widest = 0.066 * max(map(len, named), default=0) + 0.55
    columns = max(1, min(len(named), int(figure.get_figwidth() / widest)))
    place: Any = "lower center" if figure.get_layout_engine() is None else "outside lower center"
    figure.legend(named.values(), named.keys(), loc=place, ncols=columns)


def log_axis(axis: Axis, values: Any) -> None:
    """A log axis with room about the values, and plain numbers at 1, 2, 5 where decades are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known) & (known > 0.0)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (1.0, 1.0)
    middle, half = math.sqrt(low * high), max(math.sqrt(high / low) * 1.3, 3.0)
    limits: Any = {"scale": "log", "lim": (middle / half, middle * half)}
    axis.axes.set(**{f"{axis.axis_name}{key}": value for key, value in limits.items()})  # type: ignore[attr-defined]
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if half < 6.0 else (1.0,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(NullLocator())


def pose_ticks(panel: Axes, names: Sequence[str]) -> None:
    """Names below the axis, upright where they would meet; every k-th of many."""
    inches = 0.85 * panel.figure.get_figwidth()  # type: ignore[union-attr]
    step = -(-len(names) // max(2, int(inches / 0.16)))
    shown = range(0, len(names), step)
    labels = [elided(names[i]) for i in shown]
    upright = len(labels) * max(map(len, labels)) * _LETTER > inches
    panel.set_xticks(list(shown), labels, rotation=90 if upright else 0, fontsize=9)
    panel.grid(False, axis="x")


def elided(name: str, most: int = _NAME) -> str:
    """A name that fits beside an axis: the middle of a long one is left out.

    >>> elided("p01_loaded"), elided("a_very_long_name_that_somebody_gave", 24)
    ('p01_loaded', 'a_very_long_…mebody_gave')
    """
    half = most // 2
    return name if len(name) <= most else f"{name[:half]}\N{HORIZONTAL ELLIPSIS}{name[-half + 1 :]}"


def brief(names: Sequence[str]) -> list[str]:
    """Labels of parameters without what is plain from the rest; whole where two would be alike.

    >>> brief(["geometry:A2.x", "tool:marker:m1.x", "plain"]), brief(["a:A2.x", "b:A2.x"])
    (['A2 x', 'm1 x', 'plain'], ['a:A2.x', 'b:A2.x'])
    """
    labels = [
        name.rsplit(":", 1)[-1].replace(".", " ", 1) if ":" in name else name for name in names
    ]
    return [
        elided(label if labels.count(label) == 1 else name)
        for name, label in zip(names, labels, strict=True)
    ]


def svg(figure: Figure, name: str, description: str = "") -> str:
    """The figure as SVG, labelled by its description; name : keeps its identifiers apart."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}), warnings.catch_warnings():
        # The viewer's fonts write the names, and a narrow sheet is no news to its reader.
        warnings.filterwarnings("ignore", "Glyph .* missing|constrained_layout not", UserWarning)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine(None)  # else all is drawn once more to find its place
        figure.savefig(buffer, format="svg", dpi=160, metadata={"Date": None, "Creator": "posecal"})
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", buffer.getvalue(), flags=re.DOTALL)
    text = re.sub("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]", "\N{REPLACEMENT CHARACTER}", text)
    referred = set(re.findall(r"#([\w-]+)", text))
    text = re.sub(r' id="([^"]*)"', lambda named: named[0] if named[1] in referred else "", text)
    text = re.sub(r' transform="rotate\(-0 [^"]*"', "", text)
    text = re.sub(r' (?:d|x|y|transform)="[^"]*"', _rounded, text)
    text = re.sub(
        r"\n\s*", "\n", text[text.index("<svg") :]
    )  # no blank line: one block of Markdown
    for _ in range(2):  # groups of one element
        text = re.sub(r"<g>\n(<[^g/][^\n]*)\n</g>", r"\1", text)
    label = f'<svg role="img" aria-label="{escape(description)}"'
    return text.replace("<svg", label, 1)


def _rounded(attribute: re.Match[str]) -> str:
    """Coordinates to a tenth of a point, lines to one."""
    return " " + " ".join(re.sub(r"(\.\d)\d+", r"\1", attribute[0]).replace(".0", "").split())
