"""Bars on one log scale beside their numbers, with a line through all where the noise is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from studies.document import Raw

_BELOW = 2.0  # the scale begins at so much less than the least
_SHORTEST = 0.4  # percent


@dataclass(frozen=True)
class Bar:
    """A labelled length; look is "good", "bad" or "floor"."""

    label: str
    value: float
    look: str


def bars(entries: Sequence[Bar], caption: str) -> Raw:
    """A table whose last column draws each value on a log scale that a last row names."""
    values = [entry.value for entry in entries if entry.value > 0.0] or [1.0]
    low, high = min(values) / _BELOW, max(values)

    def along(value: float) -> float:
        if value <= low:
            return _SHORTEST
        return max(_SHORTEST, 100.0 * math.log(value / low) / math.log(high / low))

    lines = Markup("").join(
        Markup('<i style="left: {:.2f}%"></i>').format(along(entry.value))
        for entry in entries
        if entry.look == "floor"
    )
    rows = Markup("").join(
        Markup(
            '<tr><th scope="row">{}</th><td class="number">{}</td><td class="bar" aria-hidden="true">'
            '<span class="{}" style="width: {:.2f}%"></span>{}</td></tr>'
        ).format(e.label, f"{e.value:#.3g}".rstrip("."), e.look, along(e.value), lines)
        for e in entries
    )
    ticks = Markup("").join(
        Markup('<span style="left: {:.2f}%">{:g}</span>').format(along(tick), tick)
        for tick in _powers(low, high)
    )
    scale = Markup('<tfoot aria-hidden="true"><tr><td colspan="2"></td><td>{}</td></tr></tfoot>')
    return Raw(
        Markup('<table class="bars"><caption>{}</caption><tbody>{}</tbody>{}</table>').format(
            caption, rows, scale.format(ticks)
        )
    )


def _powers(low: float, high: float) -> list[float]:
    """Powers of ten between; those of five, too, where they are few.

    >>> _powers(0.008, 4.3), _powers(0.02, 0.09)
    ([0.01, 0.1, 1.0], [0.05])
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [float(f"1e{decade}") for decade in decades]
    if high < 10.0 * low:
        found = [float(f"{step}e{decade}") for decade in decades for step in (1, 2, 5)]
    return [tick for tick in found if low < tick < high]
