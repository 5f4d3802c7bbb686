"""Causes of error that a model lacks, as a diagnosis and a plan's forecast name them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Annotated, TypeVar

from studies.document import Sentence, Shown, labelled
from studies.record import Entry, Maybe


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


class Sought(CauseEntry):
    """A cause with the smallest size that is found nine times in ten, None where no size would be.

    left_mm : what it leaves at the targets if it hides, at the most that such an error plausibly is
    """

    minimum_detectable: Maybe
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
    said = (f"{_shortly(causes)}: {reason}" for reason, causes in reasons.items())
    yield from labelled("not tested", said)


def _shortly(causes: Sequence[CauseEntry]) -> str:
    """Effects with their places, or without where there are many."""
    places = Counter(cause.effect for cause in causes)
    many = {effect: count for effect, count in places.items() if count > _PLACES}
    return gathered(causes, many)
