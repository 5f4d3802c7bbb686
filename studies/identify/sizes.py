"""How large errors are by the readings, as a record says it and as it is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

from studies.document import TENTH, TWO, Sentence, listed
from studies.record import Entry, Positive

if TYPE_CHECKING:
    from calib.population.sizes import Widths


class Width(Entry):
    """Standard deviation, between such errors, of those of one effect that have one unit."""

    effect: str
    width: Positive
    unit: str


class Sizes(Entry):
    """What holds the values that the readings leave open.

    parameters : how many of them it determines in place of the readings
    """

    parameters: Positive
    widths: tuple[Width, ...]


def sizes_entry(found: Widths) -> Sizes:
    """The entry of the widths that an identification found."""
    of = found.of
    return Sizes(
        parameters=found.saved,
        widths=tuple(
            Width(effect=kind, width=float(width / scale), unit=unit)
            for (kind, unit), width, scale in zip(of.classes, found.widths, of.scales, strict=True)
        ),
    )


def told_sizes(sizes: Sizes) -> Sentence:
    """That sizes decided, and which."""
    widths = [f"{own.effect} {TWO(own.width)} {own.unit}" for own in sizes.widths]
    return Sentence(
        f"the readings barely determine about {TENTH(sizes.parameters)} combinations of "
        f"parameters. There the result leans on usual sizes of errors: {listed(widths)}. "
        '[model] size_prior = "off" switches it off',
        "note",
        "sizes",
    )
