"""How an identified robot stands to its type: its entries, and how they are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from studies import document as doc
from studies.document import FOUR, TENTH, Shown, listed, plural
from studies.record import OWN_UNIT, Count, Entry, From, Maybe, NotNegative, Number, Positive

if TYPE_CHECKING:
    from calib import Identification
    from calib.population import Departure

_MOST = 10  # parameters that the terminal shows


class ParameterOfType(Entry):
    """A parameter beside its type; std : of one robot more.

    score : how far it leaves the mean, in standard deviations of how far it would in a robot of the
        type, None where the readings say nothing of it; released : the type is not believed for it
    """

    id: str
    value: Annotated[Number, OWN_UNIT]
    mean: Annotated[Number, Shown("mean of the type"), OWN_UNIT]
    std: Annotated[Positive, Shown("spread of the type", FOUR), OWN_UNIT]
    score: Annotated[Maybe, Shown(rule=TENTH)]
    released: bool
    unit: str

    @property
    def size(self) -> float:
        """How far, either way."""
        return abs(self.score or 0.0)


class OfType(Entry):
    """The robot beside its type.

    robots : that the type was learnt from; statistic : squared scores together, of so many rows
    p : of so large a one in a robot of the type; widened : factor on the type's deviations
    """

    type: str
    robots: Count
    statistic: NotNegative
    rows: Count
    p: Annotated[NotNegative, From("p_value")]
    of_the_type: bool
    widened: Annotated[Positive, From("factor")]
    parameters: tuple[ParameterOfType, ...]


def of_type_entry(found: Identification, stood: Departure) -> OfType:
    """The entry of an identification that was made beside a type."""
    prior = stood.prior
    at = found.model.own_prior_at[: len(prior.keys)]
    rows = ParameterOfType.from_each(
        [found.model.parameters[i] for i in at],
        value=found.values[at],
        mean=prior.mean,
        std=prior.std,
        score=stood.scores,
        released=[key in stood.released for key in prior.keys],
    )
    return OfType.from_result(stood, prior, parameters=rows)


def told_of_type(found: OfType) -> Iterator[doc.Part]:
    """Whether the robot is of its type, and what left it farthest."""
    whole = f"{plural(found.robots, 'robot')} of {found.type}"
    if found.of_the_type:
        yield doc.Sentence(f"This robot is like the {whole} before it (p {doc.P(found.p)}).")
    else:
        out = [own.id for own in found.parameters if own.released]
        what = f"for {listed(out, 5)} they are not used" if out else "they count less everywhere"
        yield doc.Sentence(
            f"This robot differs from the {whole} (p {doc.P(found.p)}): {what}.", "warn"
        )
    rows = sorted(found.parameters, key=lambda own: (not own.released, -own.size))
    caption = (
        "Score: distance of the value from the type's mean, in standard deviations of what robots "
        "of the type show"
    )
    yield doc.Table(_LEFT, rows, "Each parameter beside its type", caption, most=_MOST)


_LEFT = doc.columns(
    ParameterOfType,
    "id value mean std score",
    doc.Column("type", lambda own: "not used" if own.released else "", detail=True),
    "unit",
)
