"""How the error falls, effect by effect, from the model as it was to what is left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.diagnose.record import Steps
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_DIGITS = 9
_HEIGHT = 0.62
_TEXT = 0.16  # width of a number, over the longest bar


@style.styled
def waterfall(steps: Steps, floor_mm: float) -> style.Picture:
    """RMS before, what each effect takes off it when it is added to those above, and what is left.

    floor_mm : RMS of the noise alone, above zero
    """
    values, names, low = np.array(steps.rms_mm), steps.added, floor_mm
    n, of = len(names), steps.of
    labels = ["before: model as given", *names, *(["after: what is left"] if n else [])]
    figure = style.sheet(style.PANEL, 1.5 + 0.44 * len(labels))
    panel = figure.subplots()
    style.tidy(panel, "x")
    most = max(float(values.max()), low)
    digits = min(max(0, 2 - int(np.floor(np.log10(most)))), _MOST_DIGITS)
    for at, (end, text) in enumerate([*_bars(panel, values, digits)]):
        _number(panel, at, low if end <= low < end + _TEXT * most else end, text)
    line = panel.axvline(
        low,
        color=style.INK,
        linewidth=1.4,
        linestyle=(0, (4, 2)),
        label=f"floor: noise alone, {style.short(low)} {steps.unit}",
    )
    panel.set_yticks(range(len(labels)), labels)
    panel.tick_params(axis="y", length=0)
    panel.set(xlim=(0.0, (1.0 + _TEXT) * most), ylim=(len(labels) - 0.4, -0.6))
    panel.set_xlabel(f"RMS error at {of} [{steps.unit}]")
    style.legend_below(figure, [line, *_key(values)])
    caption = f"3-D root mean square error of the {of}. " + (
        "Each effect is added to those above it and the whole model fitted again, so that a bar is "
        "what the effect still takes off; where effects overlap the order matters. "
        if n
        else "No effect was found that would take anything off. "
    )
    caption += (
        f"What is left is {values[-1] / low:.2f} times the floor, which noise alone would leave."
    )
    header = ("step", *(f"{what} [{steps.unit}]" for what in ("RMS", "change", "floor")))
    title = f"The error before, {style.short(values[0])} {steps.unit}, and what no cause explains"
    if n:
        was, now = (style.short(float(value), 2) for value in (values[0], values[-1]))
        title = f"What each cause takes off: from {was} to {now} {steps.unit}"
    rows = tuple(_rows(labels, values, low))
    return style.Picture("waterfall", title, caption, figure, header, rows)


def _rows(labels: Sequence[str], values: Array, floor: float) -> Iterator[tuple[style.Cell, ...]]:
    """The error at each step and its change; at the end what is left."""
    changes: list[float | None] = [None, *np.diff(values).tolist()]
    for label, value, change in zip(labels, values.tolist(), changes, strict=False):
        yield label, value, change, floor
    if len(values) > 1:
        yield labels[-1], float(values[-1]), None, floor


def _bars(panel: Axes, values: Array, digits: int) -> Iterator[tuple[float, str]]:
    """Draw the error before, its changes and what is left; yields each bar's end and number."""
    n = len(values) - 1
    _bar(panel, 0, 0.0, values[0], {"color": "0.72"})
    yield values[0], f"{values[0]:.{digits}f}"
    for i in range(n):
        start, end = values[i], values[i + 1]
        worse = end > start
        look: Any = {
            "color": style.VERMILLION if worse else style.BLUE,
            "hatch": "//" if worse else "",
        }
        _bar(panel, i + 1, start, end, look)
        _step(panel, i, start)
        sign = "+" if worse else "\N{MINUS SIGN}"
        yield max(start, end), f"{sign}{abs(end - start):.{digits}f}"
    if n:
        _step(panel, n, values[n])
        _bar(panel, n + 1, 0.0, values[n], {"color": "0.45"})
        yield values[n], f"{values[n]:.{digits}f}"


def _bar(panel: Axes, at: int, start: float, end: float, look: Any) -> None:
    panel.barh(
        at,
        abs(end - start),
        _HEIGHT,
        left=min(start, end),
        edgecolor="white",
        linewidth=0.0,
        **look,
    )


def _step(panel: Axes, above: int, at: float) -> None:
    """The line that leads from one bar to the next."""
    ends = [above - _HEIGHT / 2, above + 1 + _HEIGHT / 2]
    panel.plot([at, at], ends, color=style.SOFT, linewidth=0.8)


def _number(panel: Axes, at: int, end: float, text: str) -> None:
    panel.annotate(
        text,
        (end, at),
        (5.0, -0.5),
        textcoords="offset points",
        va="center",
        ha="left",
        color=style.INK,
    )


def _key(values: Array) -> list[Any]:
    """Entries for what the bars mean, those that occur."""
    from matplotlib.patches import Patch

    change = np.diff(values)
    found = []
    if (change <= 0.0).any():
        found.append(Patch(facecolor=style.BLUE, label="taken off by an effect"))
    if (change > 0.0).any():
        found.append(
            Patch(
                facecolor=style.VERMILLION,
                hatch="//",
                edgecolor="white",
                linewidth=0.0,
                label="added by an effect",
            )
        )
    return found
