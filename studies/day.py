"""The day of a plan as results tell it: how long it takes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from studies.document import Sentence, listed
from studies.record import Entry, From, Maybe, NotNegative

_MINUTE = 60.0


class DayEntry(Entry):
    """The time that the poses take in their order.

    seconds : of the whole day, None where not all joint speeds are known; moving_s, standing_s : on the
        way and at the poses
    speedless : joints of which no speed is known
    """

    speed_percent: Annotated[NotNegative, From("cell.pace.speed")]
    seconds: Maybe
    moving_s: Maybe
    standing_s: NotNegative
    speedless: tuple[str, ...] = ()


def told(day: DayEntry) -> Iterator[Sentence]:
    """The time that it takes."""
    if day.seconds is None or day.moving_s is None:
        yield Sentence(
            f"unknown, as {listed(day.speedless)} has no speed: give [robot.speed_deg_s] (or "
            "[robot.speed_mm_s]) in the cell",
            label="duration",
        )
        return
    yield Sentence(
        f"{minutes(day.seconds)}: {minutes(day.moving_s)} on the way at {day.speed_percent:g} % of the "
        f"joint speeds; {minutes(day.standing_s)} at the poses",
        label="duration",
    )


def minutes(seconds: float) -> str:
    """A time that people plan by.

    >>> minutes(42.4), minutes(754.0), minutes(9000.0)
    ('42 s', '13 min', '2.5 h')
    """
    if seconds < 2 * _MINUTE:
        return f"{seconds:.0f} s"
    if seconds < 120 * _MINUTE:
        return f"{seconds / _MINUTE:.0f} min"
    return f"{seconds / _MINUTE / 60.0:.1f} h"
