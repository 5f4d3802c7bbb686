"""The identified parameters, and what the readings leave open, as entries of the record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies.document import Shown
from studies.record import OWN_UNIT, Entry, From, Maybe, MaybePositive, Number, Positive

if TYPE_CHECKING:
    from calib import Identification
    from calib.population.sizes import Widths

_PLACED = ("base", "tool")


class IdentifiedParameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    std_by_pose : if the points of a pose err together, as under a model that lacks something
    step_two_optimism : factor by which it would be less if base and tool were known
    """

    id: str
    name: Annotated[str, Shown("parameter")]
    effect: str
    where: str
    value: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, OWN_UNIT]
    ci95: Annotated[tuple[Number, Number] | None, OWN_UNIT]
    degrees_of_freedom: Maybe = None
    std_by_pose: Annotated[Maybe, OWN_UNIT]
    step_two_optimism: Maybe
    unit: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in _PLACED


class Absorbed(Entry):
    """A constant that others stand for at any pose."""

    id: Annotated[str, Shown("constant error")]
    absorbed_by: tuple[str, ...]


class Width(Entry):
    """Standard deviation, between such errors, of those of one effect that have one unit."""

    effect: Annotated[str, From("0")]
    width: Annotated[Positive, OWN_UNIT]
    unit: Annotated[str, From("1")]


class SizesEntry(Entry):
    """What holds the values that the readings leave open.

    parameters : how many of them it determines in place of the readings
    """

    parameters: Annotated[Positive, From("saved")]
    widths: tuple[Width, ...]


def parameter_entries(found: Identification) -> tuple[IdentifiedParameter, ...]:
    """The entries of all parameters, in the order of the model."""
    known = (found.std > 0.0) & np.isfinite(found.std)
    nothing = np.full(len(found.values), np.nan)
    return IdentifiedParameter.from_each(
        found.model.parameters,
        value=found.values,
        std=np.where(known, found.std, np.nan),
        ci95=[own if k else None for own, k in zip(found.interval().tolist(), known, strict=True)],
        degrees_of_freedom=np.where(known, found.freedoms, np.nan),
        std_by_pose=nothing if found.std_by_pose is None else found.std_by_pose,
        step_two_optimism=found.optimism,
    )


def absorbed_entries(found: Identification) -> tuple[Absorbed, ...]:
    """The entries of the constants left out for others."""
    by = [[name for name, _ in own.absorbed_by] for own in found.absorbed]
    return Absorbed.from_each(found.absorbed, absorbed_by=by)


def sizes_entry(found: Widths) -> SizesEntry:
    """The entry of the widths that an identification found."""
    of = found.of
    widths = Width.from_each(of.classes, width=found.widths, scale=of.scales)
    return SizesEntry.from_result(found, widths=widths)
