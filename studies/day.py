"""The day of a plan as results tell it: its ways, what they were checked for, and how long it takes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from studies.document import Sentence, listed
from studies.entries import JointValues, shown_joints
from studies.record import Count, Entry, From, Maybe, NotNegative

if TYPE_CHECKING:
    from doe.day.day import PlannedDay

_MINUTE = 60.0


class WayPoint(JointValues):
    """A point on a way that is no pose: the arm goes over it in straight joint motions."""


class WayEntry(Entry):
    """A way that is not straight from one pose to the next, or that is not known.

    meets : what the straight one meets; known : whether there is a way round, over ``points``
    """

    start: str
    end: str
    meets: str
    known: Annotated[bool, From("free")]
    points: tuple[WayPoint, ...] = ()


class LastMove(JointValues):
    """The last move of each joint to a pose, with its sign: from the side that is prescribed."""


class DayEntry(Entry):
    """The ways between the poses in their order, and the time that a day takes.

    checked : what the ways are checked for, empty where nothing is; margin : of floor and obstacles
    seconds : of the whole day, None where not all joint speeds are known; moving_s, standing_s : on the
        way and at the poses; least_moving_s : no order of the poses takes less
    followed : markers of which one stays in sight on each way, empty where none is asked for
    speedless : joints of which no speed is known
    """

    ways: Count
    direct: Count
    others: tuple[WayEntry, ...] = ()
    checked: tuple[str, ...] = ()
    margin_mm: Annotated[NotNegative, From("cell.design.margin")] = 0.0
    followed: tuple[str, ...] = ()
    speed_percent: Annotated[NotNegative, From("cell.pace.speed")]
    seconds: Maybe
    moving_s: Maybe
    standing_s: NotNegative
    least_moving_s: Maybe
    speedless: tuple[str, ...] = ()


def day_entry(day: PlannedDay) -> DayEntry:
    """The entry of a day."""
    cell, names = day.cell, day.poses.names
    others = [
        WayEntry.from_result(
            way,
            start=names[i],
            end=names[i + 1],
            points=[WayPoint(**shown_joints(cell.robot, q)) for q in way.between],
        )
        for i, way in enumerate(day.ways)
        if way.meets
    ]
    return DayEntry.from_result(
        day,
        others=others,
        followed=sorted({way.follows for way in day.ways} - {""}),
    )


def told(day: DayEntry) -> Iterator[Sentence]:
    """The ways, and the time; nothing of ways that nothing was checked for."""
    if day.checked and day.ways:
        around = sum(way.known for way in day.others)
        checked = listed([name.replace("_", " ") for name in day.checked])
        margin = f", margin {day.margin_mm:g} mm" if day.margin_mm else ""
        yield Sentence(
            f"{day.direct + around} of {day.ways} between poses are free: {day.direct} straight, "
            f"{around} over points between (checked: {checked}{margin})",
            label="ways",
        )
    for way in day.others:
        if not way.known:
            yield Sentence(
                f"no way was found from {way.start} to {way.end}: the straight one meets {way.meets}. "
                "Drive there by hand, or leave one of them out",
                "warn",
            )
    if day.seconds is None or day.moving_s is None:
        yield Sentence(
            f"unknown, as {listed(day.speedless)} has no speed: give [robot.speed_deg_s] (or "
            "[robot.speed_mm_s]) in the cell",
            label="duration",
        )
        return
    least = day.least_moving_s or 0.0
    share = "" if day.moving_s <= 0.0 else (
        f"; no order of these poses saves more than {100.0 * (1.0 - least / day.moving_s):.0f} % of it"
    )  # fmt: skip
    yield Sentence(
        f"{minutes(day.seconds)}: {minutes(day.moving_s)} on the way at {day.speed_percent:g} % of the "
        f"joint speeds{share}; {minutes(day.standing_s)} at the poses",
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
