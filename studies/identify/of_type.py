"""How an identified robot stands to its type: its entries, and how they are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from studies import document as doc
from studies.document import FOUR, TENTH, Shown, listed, plural
from studies.record import Count, Entry, Maybe, NotNegative, Number, Positive

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
    value: Number
    mean: Annotated[Number, Shown("mean of the type")]
    std: Annotated[Positive, Shown("spread of the type", FOUR)]
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
    p: NotNegative
    of_the_type: bool
    widened: Positive
    parameters: tuple[ParameterOfType, ...]


def of_type_entry(found: Identification, stood: Departure) -> OfType:
    """The entry of an identification that was made beside a type."""
    prior, model = stood.prior, found.model
    rows = []
    for k, at in enumerate(model.own_prior_at[: len(prior.keys)].tolist()):
        p = model.parameters[at]
        row = ParameterOfType.from_result(
            p,
            value=found.values[at] / p.scale,
            mean=prior.mean[k] / p.scale,
            std=prior.std[k] / p.scale,
            score=stood.scores[k],
            released=prior.keys[k] in stood.released,
        )
        rows.append(row)
    return OfType.from_result(stood, prior, p=stood.p_value, widened=stood.factor, parameters=rows)


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
