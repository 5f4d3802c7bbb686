"""One look for all figures, and how a figure is written with its numbers.

Colours are those of Okabe and Ito, each with a marker, a line style and a hatch of its own: nothing is
told by colour alone. Text stays text in the SVG; the same data give the same bytes.
"""

from __future__ import annotations

import csv
import functools
import io
import math
import re
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

import numpy as np

from calib.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

P = ParamSpec("P")
T = TypeVar("T")
Cell: TypeAlias = str | float | None

BLACK, BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY = (
    "#000000",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
)
INK, SOFT, FAINT = "0.15", "0.45", "0.85"
DASHED: Any = (0, (4, 2))
DPI = 200
PANEL = 5.0
"""Inches: width of a figure of one panel, which a phone shows whole with its text still legible."""
_VECTOR = 1500  # points; a larger cloud becomes a picture within the SVG
_STROKE = 5e-4  # of a cloud's width: length of the stroke that draws a point
_NAME, _PARAMETER = 24, 48  # letters of a name beside an axis
_LETTERS = 10.5  # of a title, an inch
_LINE, _LEFT = 0.21, 0.1  # inch: height of a line of the title, and room before it
_FEWEST = 3  # ticks of a log axis
_STEPS = (  # in a decade
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0),
)
_COARSE = ((1.0,), (1.0, 3.0))
_UPRIGHT, _LETTER = 0.15, 0.13  # inch: an upright name, and a letter with the room about it
_NOT_IN_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")  # may stand in names
RC: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 10,
    "axes.titlesize": 10,
    "legend.fontsize": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "posecal",
    "hatch.linewidth": 0.6,
    "text.parse_math": False,  # a dollar in a name is a dollar
}


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with its numbers.

    name : str, of its files, without suffix
    title, caption : str, plain text; the caption says what is seen and how to read it
    figure : Figure
    header : tuple of str, the columns with their units
    rows : tuple of rows of the table; None where there is no value
    """

    name: str
    title: str
    caption: str
    figure: Figure
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Look:
    """How one line, bar or point is drawn.

    sign : its marker as a character; face : colour of the marker's inside where it is another
    """

    label: str
    color: str
    marker: str
    linestyle: Any = ""
    hatch: str = ""
    sign: str = ""
    face: str = ""

    @property
    def mark(self) -> dict[str, Any]:
        """Keywords of markers."""
        return {
            "color": self.color,
            "marker": self.marker,
            "markerfacecolor": self.face or self.color,
        }

    @property
    def line(self) -> dict[str, Any]:
        """Keywords of a line with markers."""
        return {**self.mark, "linestyle": self.linestyle}


APPROACHES: Mapping[str, Look] = {
    "pose plain": Look("#1 pose, plain", VERMILLION, "o", ":", "//", "●"),
    "pose normalised": Look("#1 pose, normalised", PURPLE, "s", "-.", "\\\\", "■"),
    "pose full": Look("#1 pose, full covariance", GREEN, "^", "--", "xx", "▲"),
    "points": Look("#2 points", BLUE, "D", "-", "", "◆"),
}
SERIES: tuple[Look, ...] = (
    Look("", BLACK, "o", "-", "", "●"),
    Look("", BLUE, "s", "--", "//", "■"),
    Look("", VERMILLION, "^", "-.", "\\\\", "▲"),
    Look("", GREEN, "D", ":", "xx", "◆"),
    Look("", PURPLE, "v", (0, (5, 1, 1, 1, 1, 1)), "..", "▼"),
    Look("", ORANGE, "P", (0, (8, 2)), "++", "✚"),
    Look("", SKY, "X", (0, (1, 1)), "oo", "✖"),
)


def looks(keys: Iterable[str], solid: bool = False) -> dict[str, Look]:
    """The look of each key: approaches keep theirs, others take the next that is free.

    solid : bool, for bars, which are too heavy in black
    """
    keys = list(dict.fromkeys(keys))
    known = [key for key in keys if key in APPROACHES]
    taken = {APPROACHES[key].color for key in known}
    free = [look for look in SERIES if look.color not in taken][solid:]
    others = [key for key in keys if key not in APPROACHES]
    return {key: APPROACHES[key] for key in known} | {
        key: replace(free[i % len(free)], label=elided(key, _PARAMETER))
        for i, key in enumerate(others)
    }


# -- drawing -----------------------------------------------------------------------------------


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function under the common settings, whatever the user's are."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        import matplotlib as mpl

        with mpl.rc_context(RC):
            return function(*args, **kwargs)

    return run


def sheet(width: float, height: float, layout: str = "constrained") -> Figure:
    """An empty figure, inches; no global state. Panels of fixed aspect want layout "compressed"."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)  # type: ignore[arg-type]
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # type: ignore[union-attr, call-arg]
    return figure


def small_panels(
    count: int, across: int, size: Callable[[int, int], tuple[float, float]], **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure of so many panels, row by row.

    across : most in a row; size : of the sheet, inches, by the numbers of columns and rows
    shared : what ``Figure.subplots`` takes
    """
    columns = min(across, count)
    lines = -(-count // columns)
    figure = sheet(*size(columns, lines))
    panels = figure.subplots(lines, columns, squeeze=False, **shared).ravel().tolist()
    for panel in panels[count:]:
        panel.remove()
    return figure, panels[:count]


def tidy(panel: Axes, grid: str = "both") -> None:
    """Thin grid behind the data, no box; grid is "x", "y", "both" or "none"."""
    panel.set_axisbelow(True)
    if grid != "none":
        panel.grid(True, axis=grid, which="major", color=FAINT, linewidth=0.6)  # type: ignore[arg-type]
    panel.spines[["top", "right"]].set_visible(False)


def legend_below(figure: Figure, handles: Sequence[Any]) -> None:
    """One legend for all panels, in as many columns as fit."""
    lengths = [0.07 * len(handle.get_label()) + 0.6 for handle in handles]  # inches, about
    columns = len(handles)
    while columns > 1 and _legend_width(lengths, columns) > figure.get_figwidth() - 0.3:
        columns -= 1
    columns = -(-len(handles) // -(-len(handles) // columns))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def _legend_width(lengths: Sequence[float], columns: int) -> float:
    """Width of entries set column by column, each column as wide as its widest."""
    lines = -(-len(lengths) // columns)
    return sum(max(lengths[i : i + lines]) for i in range(0, len(lengths), lines))


def dots(panel: Axes, x: Any, y: Any, **look: Any) -> None:
    """Points without a line."""
    panel.plot(x, y, **{"linestyle": "", "rasterized": len(x) > _VECTOR, **look})


def aside(values: Array, most: float) -> Array:
    """Values (m,) moved apart by as much at most, by a golden-ratio sequence: even and repeatable."""
    golden = (np.arange(len(values)) * 0.6180339887498949) % 1.0
    return np.asarray(values + most * (2.0 * golden - 1.0))


def key_of(look: Look, **changed: Any) -> Any:
    """Entry of a legend."""
    return line_key(look.label, **(look.line | changed))


def line_key(label: str, **look: Any) -> Any:
    """Entry of a legend: a line or a mark."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **look)


def patch_key(label: str, **look: Any) -> Any:
    """Entry of a legend: an area."""
    from matplotlib.patches import Patch

    return Patch(label=label, **look)


def log_ticks(axis: Axis, low: float, high: float) -> None:
    """Plain numbers at powers of ten where many decades are shown, at 1, 2, 5 where few.

    As few as are three in view; evenly where even the closest are not.
    """
    from matplotlib.ticker import (
        FuncFormatter,
        LogLocator,
        MaxNLocator,
        NullFormatter,
        NullLocator,
    )

    steps = _STEPS if math.log10(high / low) < 2.2 else _COARSE
    fitting = [own for own in steps if len(_within(low, high, own)) >= _FEWEST]
    logarithmic = LogLocator(subs=fitting[0], numticks=20) if fitting else None
    axis.set_major_locator(logarithmic or MaxNLocator(_FEWEST + 2))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _within(low: float, high: float, steps: Sequence[float]) -> list[float]:
    """Steps of every decade that lie between.

    >>> _within(0.9, 11.0, (1.0, 5.0))
    [1.0, 5.0, 10.0]
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = (step * 10.0**decade for decade in decades for step in steps)
    return [tick for tick in ticks if low <= tick <= high]


def pose_ticks(panel: Axes, names: Sequence[str]) -> None:
    """Names below the axis, upright where they would meet; every k-th where even that is too tight."""
    inches = panel.get_position().width * panel.figure.get_figwidth()  # type: ignore[union-attr]
    step = -(-len(names) // max(2, int(inches / _UPRIGHT)))
    shown = range(0, len(names), step)
    upright = len(shown) * max(len(elided(name)) for name in names) * _LETTER > inches
    labels = [elided(names[i]) for i in shown]
    panel.set_xticks(list(shown), labels, rotation=90 if upright else 0, fontsize=9)
    panel.tick_params(axis="x", length=0)


def elided(name: str, most: int = _NAME) -> str:
    """A name that fits beside an axis: the middle of a long one is left out.

    >>> elided("p01_loaded"), elided("a_very_long_name_that_somebody_gave_to_a_pose")
    ('p01_loaded', 'a_very_long_…e_to_a_pose')
    """
    half = most // 2
    return name if len(name) <= most else f"{name[:half]}\N{HORIZONTAL ELLIPSIS}{name[-half + 1 :]}"


def short(value: float, digits: int = 3) -> str:
    """A number with few digits and no exponent where it can be avoided; empty where there is none.

    >>> short(1234.5), short(0.01234), short(3.0), short(float("nan"))
    ('1234', '0.0123', '3.00', '')
    """
    if not math.isfinite(value):
        return ""
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -5 < size < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - size)}f}"


def brief(names: Sequence[str]) -> list[str]:
    """Labels of parameters without what is plain from the rest; whole where two would be alike.

    >>> brief(["geometry:A2.x", "tool:marker:m1.x", "base:base.rz", "plain"])
    ['A2 x', 'm1 x', 'base rz', 'plain']
    >>> brief(["geometry:A2.x", "bearing_compliance:A2.x"])
    ['geometry:A2.x', 'bearing_compliance:A2.x']
    """
    labels = [
        name.rsplit(":", 1)[-1].replace(".", " ", 1) if ":" in name else name for name in names
    ]
    return [
        elided(label if labels.count(label) == 1 else name, _PARAMETER)
        for name, label in zip(names, labels, strict=True)
    ]


def cell(value: Any) -> float | None:
    """A number for a table: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


# -- writing -----------------------------------------------------------------------------------


def files(picture: Picture, folder: Path) -> dict[Path, str | bytes]:
    """``name.svg`` and ``name.csv`` of a picture, for ``calib.files.write_files``.

    A file stands alone, so its title stands in the figure; on a page it stands above.
    """
    base = folder / picture.name
    return {
        base.with_name(f"{picture.name}.svg"): svg_text(picture, headed=True),
        base.with_name(f"{picture.name}.csv"): csv_text(picture),
    }


def svg_text(picture: Picture, headed: bool = False) -> str:
    """The figure as SVG with title and description; equal for equal data.

    headed : whether the title is drawn above it
    """
    import matplotlib as mpl

    buffer = io.BytesIO()
    described = {"Title": picture.title, "Description": picture.caption}
    # The name in the salt keeps identifiers apart where several pictures stand on one page.
    with (
        mpl.rc_context({**RC, "svg.hashsalt": f"posecal {picture.name}"}),
        warnings.catch_warnings(),
    ):
        # The viewer's fonts write the names; numbers without measure may leave no room for the axes.
        # Neither is news to who reads the figure.
        warnings.filterwarnings("ignore", "Glyph .* missing|constrained_layout not", UserWarning)
        settle(picture.figure)
        with title_above(picture) if headed else nullcontext() as whole:
            picture.figure.savefig(
                buffer, format="svg", dpi=DPI, bbox_inches=whole, pad_inches=0.0,
                metadata={**described, "Date": None, "Creator": "posecal"},
            )  # fmt: skip
    text = buffer.getvalue().decode("utf-8")
    return _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def csv_text(picture: Picture) -> str:
    """The table as CSV, six digits."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(picture.header)
    for row in picture.rows:
        writer.writerow(v if v is None or isinstance(v, str) else f"{v:.6g}" for v in row)
    return buffer.getvalue()


@contextmanager
def title_above(picture: Picture) -> Iterator[Bbox]:
    """Its title above the figure, in as many lines as it asks, and the whole sheet, inches."""
    from matplotlib.transforms import Bbox

    figure = picture.figure
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(picture.title, int(width * _LETTERS))
    text = figure.text(_LEFT / width, 1.0, "\n".join(lines), va="bottom", ha="left", fontsize=11,
                       fontweight="bold")  # fmt: skip
    try:
        yield Bbox.from_extents(0.0, 0.0, width, height + _LINE * len(lines) + _LEFT)
    finally:
        text.remove()


def settle(figure: Figure) -> None:
    """Lay the figure out once: a second pass would move it by fractions of a pixel."""
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)  # without the drawing that ``draw_without_rendering`` adds
        figure.set_layout_engine(None)  # a placeholder would be drawn once more
