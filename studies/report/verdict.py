"""The box on top: the error before and after, pass or fail, and of which robot, when, by whom."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

import numpy as np
from markupsafe import Markup

from studies.document import Raw
from studies.plots.style import short
from studies.report.evidence import Evidence, Result
from studies.report.fall import FALLING, Fall, fall

_WORDS = {"pass": "Pass", "fail": "Fail", "undecided": "Not decided"}
_EPOCH = 1e9  # s: times beyond count from 1970
_KEYS: dict[str, tuple[str, ...]] = {
    "robot": ("robot", "model"),
    "serial number": ("serial",),
    "measured": ("measured", "date"),
    "operator": ("operator",),
}
"""What stands in the box, and the keys of [report] that tell it, the first that is there."""


def verdict(evidence: Evidence, told: Mapping[str, str]) -> Raw | None:
    """Of the first result that holds an error before and after; None where none does.

    told : what the user tells of the measurement, by label; it outweighs the cell's [report]
    """
    for kind in FALLING:
        for result in evidence.of(kind):
            found = fall(result.record)
            if found is not None:
                return _box(found, dict(_facts(evidence, result, told)))
    return None


def _box(found: Fall, facts: Mapping[str, str]) -> Raw:
    word, judged = Markup(), Markup()
    if found.outcome is not None:
        word = Markup("<p class=outcome>{}</p>").format(found.word or _WORDS[found.outcome])
        judged = Markup("<br>{}.").format(found.judged[:1].upper() + found.judged[1:])
    rows = Markup("").join(
        Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(label, text)
        for label, text in facts.items()
    )
    was, now = (f"{short(value)} {found.unit}" for value in (found.before, found.after))
    return Raw(
        Markup(
            '<div class="verdict {}">{}<p class=fell><span class=visually-hidden>from </span>'
            "<span class=was>{}</span> <span aria-hidden=true>\N{RIGHTWARDS ARROW}</span> "
            "<span class=visually-hidden>to </span><strong>{}</strong></p>"
            "<p class=of>{}, {} \N{RIGHTWARDS ARROW} {}.{}</p><dl class=facts>{}</dl></div>"
        ).format(_look(found), word, was, now, found.of, *found.ends, judged, rows)
    )


def _look(found: Fall) -> str:
    if found.outcome is not None:
        return found.outcome
    return "fell" if found.after < found.before else "fail"


def _facts(
    evidence: Evidence, result: Result, told: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    about = {**result.record.about, **told}
    for label, keys in _KEYS.items():
        text = next((about[key] for key in keys if key in about), "")
        if label == "robot" and not text:
            text = result.record.cell
        if label == "measured" and not text:
            text = _day(evidence, result)
        if text:
            yield label, text


def _day(evidence: Evidence, result: Result) -> str:
    """Of the first reading, where the column time_s counts from 1970; else empty."""
    measured = evidence.data.get(result.path)
    time = None if measured is None else measured.data.poses.time
    if time is None or not np.nanmin(time) > _EPOCH:
        return ""
    return datetime.fromtimestamp(float(np.nanmin(time)), UTC).date().isoformat()
