"""What the types of a fleet know, as the file that a cell names: ``[model.prior] file = ".."``.

It is read by :func:`calib.files.estimate.load_prior`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies import document as doc
from studies.document import FOUR, HUNDREDTH, Shown, listed, plural
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    From,
    NotNegative,
    Number,
    Positive,
    Record,
)

_MOST = 20  # lines of a table that a terminal shows
_FEW = 10  # robots below which plausible sizes still count


class ParameterOfPrior(Entry):
    """A parameter of a type, in its unit.

    spread : standard deviation between robots; std : of one robot more, the mean's doubt in it
    shrunk : std over the plausible size
    """

    effect: str
    where: str
    name: str
    mean: Annotated[Number, OWN_UNIT]
    spread: Annotated[NotNegative, Shown("between robots"), OWN_UNIT]
    std: Annotated[Positive, Shown("one robot more", FOUR), OWN_UNIT]
    shrunk: Annotated[Positive, Shown("of the plausible size", HUNDREDTH)]
    unit: str
    mean_si: Number = Field(alias="mean_SI")

    @property
    def id(self) -> str:
        """Its name in a model."""
        return f"{self.effect}:{self.where}.{self.name}"


class RobotAside(Entry):
    """A robot that is not of the type; p : of one so far off."""

    robot: Annotated[str, Shown("robot not of the type"), From("name")]
    p: Annotated[NotNegative, From("p_value")]


class TypePrior(Entry):
    """What robots of one nominal model have in common.

    aside : robots that did not count; unlike : whose model has other parameters; leaning : identified
        beside a type, of which they would be echoes
    """

    type: str
    nominal_sha256: tuple[str, ...]
    robots: Count
    aside: tuple[RobotAside, ...]
    unlike: tuple[str, ...]
    leaning: tuple[str, ...]
    parameters: tuple[ParameterOfPrior, ...] = Field(min_length=1)
    covariance_si: tuple[tuple[Number, ...], ...] = Field(alias="covariance_SI")

    @model_validator(mode="after")
    def _is_square(self) -> Self:
        size = len(self.parameters)
        if any(len(row) != size for row in (self.covariance_si, *self.covariance_si)):
            raise ValueError("covariance_SI has not a row and a column for each parameter")
        return self


class PriorRecord(Record):
    """What the types of a fleet know of one robot more."""

    of_one_cell: ClassVar[bool] = False
    command: Literal["prior"] = "prior"
    folder: str
    types: tuple[TypePrior, ...] = Field(min_length=1)


def told(record: PriorRecord) -> doc.Document:
    """The document of a prior."""
    parts: list[doc.Part] = []
    for own in record.types:
        parts += [
            doc.Table(_COMMON, own.parameters, f"Parameters of {own.type}", most=_MOST),
            doc.Table(_ASIDE, own.aside, f"Not of the type {own.type}", most=_MOST),
        ]
    section = doc.Section("prior", "What the types know", tuple(parts))
    return doc.Document(tuple(_headline(record)), (section,))


def _headline(record: PriorRecord) -> Iterator[doc.Sentence]:
    for own in record.types:
        share = float(np.median([p.shrunk for p in own.parameters]))
        yield doc.Sentence(
            f"{plural(own.robots, 'robot')} of {own.type}: {plural(len(own.parameters), 'parameter')} "
            f"of one robot more are known to {share:.2g} of their plausible sizes in the median."
        )
        if own.robots < _FEW:
            yield doc.Sentence(f"{own.robots} are few: plausible sizes still count beside them.")
        if own.aside:
            names = listed([one.robot for one in own.aside], 5)
            yield doc.Sentence(f"Not of the type, so they did not count: {names}.", "warn")
        if own.unlike:
            yield doc.Sentence(
                f"With other parameters in their models: {listed(own.unlike, 5)}.", "warn"
            )
        if own.leaning:
            yield doc.Sentence(
                f"Identified beside a type, so they tell nothing new of it: {listed(own.leaning, 5)}; "
                "take [model.prior] out of their cells and run the fleet again.",
                "warn",
            )


_COMMON = doc.columns(ParameterOfPrior, "id mean spread std unit shrunk")
_ASIDE = doc.columns(RobotAside, "robot p")
