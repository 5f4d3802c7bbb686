"""A camera, its bracket on the hand, or a board that slipped or was knocked at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.effects.context import Context, Expectation
from calib.effects.step import Step
from calib.effects.tuned import TunedPart

_PARTS = ("camera:", "board:")
_LOOSE = 5.0  # odds: of a robot that is bolted down and what looks at it the latter slips


@dataclass(frozen=True, eq=False)
class Moved(Step):
    """A step of what carries a camera, or of a board.

    A camera moves along and about its own axes, whether it stands or rides on the hand.
    """

    kind: ClassVar[str] = "moved"
    decided_by: ClassVar[str] = (
        "look for what is loose: camera, board or base. A second board elsewhere tells them apart"
    )
    largest: ClassVar[float] = 5e-2

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(where for where in context.parts if where.startswith(_PARTS))

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_LOOSE)


@dataclass(frozen=True, eq=False)
class MovedPart(Moved, TunedPart):
    """The same as an effect on what the camera reads."""
