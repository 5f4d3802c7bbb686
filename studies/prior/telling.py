"""What a prior of types says of itself."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter

import numpy as np

from studies.document import (
    FOUR,
    HUNDREDTH,
    Column,
    Document,
    P,
    Part,
    Section,
    Sentence,
    Table,
    listed,
    plural,
)
from studies.prior.record import ParameterOfPrior, PriorRecord, RobotAside

_MOST = 20  # lines of a table that a terminal shows
_FEW = 10  # robots below which plausible sizes still count


def told(record: PriorRecord) -> Document:
    """The document of a prior."""
    section = Section("prior", "What the types know", tuple(_parts(record)))
    return Document(tuple(_headline(record)), (section,))


def _headline(record: PriorRecord) -> Iterator[Sentence]:
    for own in record.types:
        share = float(np.median([p.shrunk for p in own.parameters]))
        yield Sentence(
            f"{plural(own.robots, 'robot')} of {own.type}: {plural(len(own.parameters), 'parameter')} "
            f"of one robot more are known to {share:.2g} of their plausible sizes in the median."
        )
        if own.robots < _FEW:
            yield Sentence(f"{own.robots} are few: plausible sizes still count beside them.")
        if own.aside:
            names = listed([one.robot for one in own.aside], 5)
            yield Sentence(f"Not of the type, so they did not count: {names}.", "warn")
        if own.unlike:
            yield Sentence(
                f"With other parameters in their models: {listed(own.unlike, 5)}.", "warn"
            )
        if own.leaning:
            yield Sentence(
                f"Identified beside a type, so they tell nothing new of it: {listed(own.leaning, 5)}; "
                "take [model.prior] out of their cells and run the fleet again.",
                "warn",
            )


def _parts(record: PriorRecord) -> Iterator[Part]:
    for own in record.types:
        yield Table(_COMMON, own.parameters, f"Parameters of {own.type}", most=_MOST)
        yield Table(_ASIDE, own.aside, f"Not of the type {own.type}", most=_MOST)


_COMMON: tuple[Column[ParameterOfPrior], ...] = (
    Column("parameter", attrgetter("id")),
    Column("mean", attrgetter("mean"), FOUR),
    Column("between robots", attrgetter("spread"), FOUR),
    Column("one robot more", attrgetter("std"), FOUR),
    Column("unit", attrgetter("unit")),
    Column("of the plausible size", attrgetter("shrunk"), HUNDREDTH),
)
_ASIDE: tuple[Column[RobotAside], ...] = (
    Column("robot not of the type", attrgetter("robot")),
    Column("p", attrgetter("p"), P),
)
