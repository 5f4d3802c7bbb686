"""Positions of the markers in the tip frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.protocol import Context, Effect, Parameter


@dataclass(frozen=True, eq=False)
class Tool(Effect):
    """Corrections of one marker's position in the tip frame, from the cell's first guess."""

    marker: int
    components: tuple[int, ...] = (0, 1, 2)
    kind: ClassVar[str] = "tool"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(f"marker:{name}" for name in context.marker_names)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.marker_names.index(where.removeprefix("marker:")))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.kind, self.where, "xyz"[c], "mm", 1e-3, 1e-2) for c in self.components
        )

    def only(self, kept: tuple[int, ...]) -> Self:
        """The same with some of its parameters, given by their positions."""
        return replace(self, components=tuple(self.components[i] for i in kept))
