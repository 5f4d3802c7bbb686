"""Bars of one scale beside their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from studies.document import Raw
from studies.document.plain import shown


@dataclass(frozen=True)
class Bar:
    """A labelled length; look is "good", "bad" or "floor"."""

    label: str
    value: float
    look: str


def bars(entries: Sequence[Bar], caption: str) -> Raw:
    """A table whose last column draws each value as a length."""
    most = max((entry.value for entry in entries), default=0.0) or 1.0
    rows = Markup("").join(
        Markup(
            '<tr><th scope="row">{}</th><td class="number">{}</td><td class="bar" aria-hidden="true">'
            '<span class="{}" style="width: {:.2f}%"></span></td></tr>'
        ).format(e.label, shown(e.value), e.look, max(0.4, 100.0 * e.value / most))
        for e in entries
    )
    return Raw(
        Markup('<table class="bars"><caption>{}</caption><tbody>{}</tbody></table>').format(
            caption, rows
        )
    )
