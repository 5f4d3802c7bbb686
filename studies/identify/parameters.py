"""The identified parameters, and those that the readings do not tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from studies.record import Entry, Maybe, MaybePositive, Number

if TYPE_CHECKING:
    from calib import Identification

_PLACED = ("base", "tool")


class Parameter(Entry):
    """An identified value; what belongs to its deviation is None where it was not estimated.

    degrees_of_freedom : behind ci95, None where the uncertainty counts as known
    std_by_pose : if the points of a pose err together, as under a model that lacks something
    step_two_optimism : factor by which it would be less if base and tool were known
    """

    id: str
    name: str
    effect: str
    where: str
    value: Number
    std: MaybePositive
    ci95: tuple[Number, Number] | None
    degrees_of_freedom: Maybe = None
    std_by_pose: Maybe
    step_two_optimism: Maybe
    unit: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in _PLACED


class Unidentifiable(Entry):
    """Parameters that the poses do not determine."""

    names: tuple[str, ...]
    reason: str


class Absorbed(Entry):
    """A constant that others stand for at any pose."""

    id: str
    absorbed_by: tuple[str, ...]


def parameter_entries(found: Identification) -> Iterator[Parameter]:
    """The entries of all parameters, in the order of the model."""
    by_pose = np.full(len(found.values), np.nan) if found.std_by_pose is None else found.std_by_pose
    for p, value, std, (low, high), dof, own, factor in zip(
        found.model.parameters, found.values.tolist(), found.std.tolist(),
        found.interval().tolist(), found.freedoms.tolist(), by_pose.tolist(),
        found.optimism.tolist(), strict=True,
    ):  # fmt: skip
        known = 0.0 < std < np.inf
        yield Parameter(
            id=p.id,
            name=p.name,
            effect=p.effect,
            where=p.where,
            value=value / p.scale,
            std=std / p.scale if known else None,
            ci95=(low / p.scale, high / p.scale) if known else None,
            degrees_of_freedom=dof if known else None,
            std_by_pose=own / p.scale,
            step_two_optimism=factor,
            unit=p.unit,
        )


def unidentifiable_entries(found: Identification) -> tuple[Unidentifiable, ...]:
    """The entries of what the poses do not determine."""
    return tuple(Unidentifiable(names=u.names, reason=u.reason) for u in found.unidentifiable)


def absorbed_entries(found: Identification) -> tuple[Absorbed, ...]:
    """The entries of the constants left out for others."""
    return tuple(
        Absorbed(id=d.id, absorbed_by=tuple(name for name, _ in d.absorbed_by))
        for d in found.absorbed
    )
