"""Positions of the markers, and of bodies, in the tip frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.arm.se3 import fit_rigid, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import Effect, Parameter

_BODY = "body:"
_MARKER = "marker:"


@dataclass(frozen=True, eq=False)
class Tool(Effect):
    """Corrections of one marker's position in the tip frame, from the cell's first guess."""

    marker: int
    components: tuple[int, ...] = (0, 1, 2)
    kind: ClassVar[str] = "tool"
    lasting: ClassVar[bool] = False

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        alone = (f"{_MARKER}{name}" for name in context.single_markers)
        return (*alone, *(f"{_BODY}{name}" for name in context.bodies))

    @classmethod
    def at(cls, context: Context, where: str) -> Tool:
        if where.startswith(_BODY):
            own = context.bodies[where.removeprefix(_BODY)]
            return Body(where, own.start, guess=context.markers[own])
        return cls(where, context.marker_names.index(where.removeprefix(_MARKER)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.kind, self.where, "xyz"[c], "mm", 1e-3, 1e-2) for c in self.components
        )

    @property
    def markers(self) -> slice:
        """Positions of the markers that it moves, k of them."""
        return slice(self.marker, self.marker + 1)

    def offsets(self, values: Array) -> Array:
        """By how much they move, shape (..., k, 3), m, tip axes."""
        moved = np.zeros((*values.shape[:-1], 1, 3))
        moved[..., 0, list(self.components)] = values
        return moved

    def columns(self, values: Array) -> Array:
        """The derivative of that, shape (..., k, 3, p)."""
        return np.eye(3)[None, :, list(self.components)]

    def values_at(self, offsets: Array) -> Array:
        """The values (p,) that move its markers by (k, 3), m, as far as they can."""
        return np.asarray(offsets[0, list(self.components)])

    def only(self, kept: tuple[int, ...]) -> Self:
        return replace(self, components=tuple(self.components[i] for i in kept))


@dataclass(frozen=True, eq=False)
class Body(Tool):
    """Where a body sits on the tip: first point and rotation vector, in tip axes, from the guess.

    marker : position of its first point among the markers; the others follow
    guess : ndarray, shape (k, 3), m, these points: of a frame, its origin and the ends of two axes
    """

    components: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    guess: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        own = [(c, "mm") for c in "xyz"] + [(f"r{c}", "mrad") for c in "xyz"]
        chosen = (own[i] for i in self.components)
        return tuple(Parameter(self.kind, self.where, *c, 1e-3, 1e-2) for c in chosen)

    @property
    def markers(self) -> slice:
        return slice(self.marker, self.marker + len(self.guess))

    @property
    def _arms(self) -> Array:
        return np.asarray(self.guess - self.guess[0])

    def _whole(self, values: Array) -> Array:
        found = np.zeros((*values.shape[:-1], 6))
        found[..., list(self.components)] = values
        return found

    def offsets(self, values: Array) -> Array:
        xi = self._whole(values)
        turned = rotate(so3_exp(xi[..., 3:])[..., None, :, :], self._arms)
        return turned - self._arms + xi[..., None, :3]

    def columns(self, values: Array) -> Array:
        r = self._whole(values)[..., 3:]
        turn = -(so3_exp(r)[..., None, :, :] @ skew(self._arms))
        turn = turn @ so3_right_jacobian(r)[..., None, :, :]
        whole = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1)
        return np.asarray(whole[..., list(self.components)])

    def values_at(self, offsets: Array) -> Array:
        T = fit_rigid(self._arms + offsets, self._arms)
        shift = offsets[0]
        return np.concatenate([shift, so3_log(T[:3, :3])])[list(self.components)]
