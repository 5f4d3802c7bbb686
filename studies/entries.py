"""Entries that results share: causes of error, joint values, the accuracy at each target."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Annotated, TypeVar

import numpy as np

from studies.document import JOINT, Column, Rule, Sentence, Shown, labelled
from studies.record import Entry, From, Maybe, Number

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array


class CauseEntry(Entry):
    """An effect at a place."""

    effect: Annotated[str, Shown("cause")]
    where: str

    @property
    def key(self) -> str:
        """``effect:where``."""
        return f"{self.effect}:{self.where}"


C = TypeVar("C", bound=CauseEntry)
_PLACES = 3  # that are worth naming one by one


class DetectionLimitEntry(CauseEntry):
    """A cause with the smallest size that is found nine times in ten, None where no size would be.

    left_mm : what it leaves at the targets if it hides, at the most that such an error plausibly is
    """

    minimum_detectable: Annotated[Maybe, From("smallest", own_unit=True)]
    unit: str
    left_mm: Annotated[Maybe, Shown("leaves")] = None


class NotAskedEntry(Entry):
    """A cause, ``effect:where``, that the columns of the table cannot speak of, and why."""

    effect: str
    reason: str


def gathered(causes: Iterable[CauseEntry], of: Mapping[str, int] | None = None) -> str:
    """``effect:where,where`` of each effect; its name alone where those are all of several places.

    of : effect -> the number of places that were asked

    >>> both = [CauseEntry(effect="backlash", where=joint) for joint in ("A1", "A2")]
    >>> gathered(both), gathered(both, {"backlash": 2})
    ('backlash:A1,A2', 'backlash')
    """
    said = []
    for effect, group in groupby(causes, key=lambda cause: cause.effect):
        places = [cause.where for cause in group]
        everywhere = len(places) == (of or {}).get(effect) and len(places) > 1
        said.append(effect if everywhere else f"{effect}:{','.join(places)}")
    return ", ".join(said)


def by_reason(pairs: Iterable[tuple[C, str]]) -> dict[str, list[C]]:
    """Causes by the reason that they share, in the order in which the reasons come first."""
    found: dict[str, list[C]] = {}
    for cause, reason in pairs:
        found.setdefault(reason, []).append(cause)
    return found


def not_asked(entries: Iterable[NotAskedEntry]) -> Iterator[Sentence]:
    """What could not be asked, by what is missing."""
    split = ((entry.effect.partition(":"), entry.reason) for entry in entries)
    reasons = by_reason(
        (CauseEntry(effect=kind, where=where), reason.partition(" cannot act: ")[2] or reason)
        for (kind, _, where), reason in split
    )
    said = []
    for reason, causes in reasons.items():
        places = Counter(cause.effect for cause in causes)
        many = {effect: count for effect, count in places.items() if count > _PLACES}
        said.append(f"{gathered(causes, many)}: {reason}")
    yield from labelled("not tested", said)


class JointValues(Entry):
    """An entry of a record that stands at joint values, by the joints' names."""

    joints_deg: dict[str, Number]
    joints_mm: dict[str, Number]


def shown_joints(robot: Robot, q: Array, what: str = "") -> dict[str, dict[str, float]]:
    """Joint values, shape (n,), rad or m, as the fields of :class:`JointValues`.

    what : before the names of the fields, as in ``nominal_joints_deg``
    """
    found: dict[str, dict[str, float]] = {f"{what}joints_deg": {}, f"{what}joints_mm": {}}
    for joint, slides, value in zip(robot.joints, robot.prismatic, q.tolist(), strict=True):
        shown = value * 1e3 if slides else math.degrees(value)
        found[f"{what}joints_{'mm' if slides else 'deg'}"][joint] = round(shown, 6) + 0.0
    return found


def read_joints(robot: Robot, shown: JointValues) -> Array:
    """Joint values, shape (n,), rad or m, of an entry."""
    return np.array(
        [
            shown.joints_mm[joint] * 1e-3 if slides else math.radians(shown.joints_deg[joint])
            for joint, slides in zip(robot.joints, robot.prismatic, strict=True)
        ]
    )


def joint_columns(
    rows: Sequence[JointValues], rule: Rule = JOINT, *, detail: bool = True
) -> tuple[Column[JointValues], ...]:
    """A column for each joint; detail : whether they are for the page only."""

    def column(name: str, unit: str) -> Column[JointValues]:
        return Column(name, lambda row: getattr(row, f"joints_{unit}")[name], rule, unit, detail)

    first = rows[:1]
    turning, sliding = (
        [n for r in first for n in getattr(r, f"joints_{u}")] for u in ("deg", "mm")
    )
    return (*(column(n, "deg") for n in turning), *(column(n, "mm") for n in sliding))
