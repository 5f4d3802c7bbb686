"""What the poses cannot tell of a ripple's cycles, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_MOST = 4  # aliases that are worth naming


def aliasing_sentences(spectra: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A sentence for each joint whose steps are equal, or of which a line might be another."""
    for entry in spectra:
        lines = [line for line in entry["lines"] if line["aliases"]]
        repeats = entry["repeats_1_turn"]
        if repeats is None and not lines:
            continue
        steps = "" if repeats is None else f" stands in steps of {360.0 / repeats:.3g} deg"
        subject = f"{entry['joint']}{steps}{', so that' if steps else ':'}"
        yield f"{subject} {_what(lines, repeats)}; steps that are not equal would tell"


def _what(lines: Sequence[Mapping[str, Any]], repeats: float | None) -> str:
    if not lines:
        return f"c and {repeats:.3g} \N{MINUS SIGN} c cycles a turn are the same at these poses"
    return " and ".join(
        f"its line at {line['cycles']:.1f} cycles a turn might as well be at {_some(line['aliases'])}"
        for line in lines
    )


def _some(aliases: Sequence[float]) -> str:
    """The first few, the others counted.

    >>> _some([8.0, 28.0]), _some([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    ('8.0 or 28.0', '1.0, 2.0, 3.0, 4.0 or 2 more')
    """
    named = [f"{cycles:.1f}" for cycles in aliases[:_MOST]]
    rest = len(aliases) - len(named)
    last = f"{rest} more" if rest else named.pop()
    return f"{', '.join(named)} or {last}" if named else last
