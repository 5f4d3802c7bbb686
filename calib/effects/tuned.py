"""Effects with one parameter that is not linear: the cycles of a ripple, a time constant, a moment.

Such an effect moves what its ``carrier`` moves, b directions that are constant, by functions of the
pose: ``xi = sum_ij amplitude_ij f_i(pose; tuning) direction_j``. The tuning is its first parameter. It
is a value, not a correction. The amplitudes follow, function by function. With all of them at zero the
model is nominal whatever the tuning.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import DirectedEffect, Effect, FrameEffect, Parameter, StretchEffect
from calib.effects.readings import MarkerEffect, PartEffect, RigidReading
from calib.poses import Poses

ANY_TUNING = 1e9
"""No bound on a tuning: the data alone speak of it."""
_DISPLACING: tuple[type[DirectedEffect], ...] = (
    FrameEffect, StretchEffect, MarkerEffect, RigidReading, PartEffect,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tuned(DirectedEffect):
    """Functions of the pose with one tuning, times directions that are constant.

    tuning : float, SI, where its search begins
    smooth : whether the functions have a derivative by it; where not, only a scan finds it
    lines : how many at different tunings one place may have; two steps would stand for any curve
    """

    tuning: float
    smooth: ClassVar[bool] = True
    lines: ClassVar[int] = 1

    @property
    @abstractmethod
    def tuning_parameter(self) -> Parameter:
        """The tuning by name and unit."""

    @property
    @abstractmethod
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The other parameters, function by function."""

    @abstractmethod
    def functions(self, poses: Poses, tuning: Array) -> Array:
        """The functions at tunings (...), SI, shape (..., m, f)."""

    @abstractmethod
    def slopes(self, poses: Poses, tuning: Array) -> Array:
        """Their derivatives by the tuning, shape (..., m, f)."""

    @abstractmethod
    def grid(self, poses: Poses) -> Array:
        """Tunings worth trying at these poses, shape (C,), ascending; empty where none is."""

    def richer(self, tunings: Array) -> tuple[Self, Array] | None:
        """The same with more functions, and tunings (C,) at which to try it where these are best."""
        return None

    def aliases(self, poses: Poses, values: Array) -> Array:
        """Other tunings at which the effect is the same at these poses, shape (k,); values (p,)."""
        return np.zeros(0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.tuning_parameter, *self.amplitudes)

    @property
    def initial(self) -> Array:
        return np.array([self.tuning] + [0.0] * len(self.amplitudes))

    def tuned(self, value: float) -> Self:
        """The same with its search beginning elsewhere."""
        return replace(self, tuning=float(value))

    def amounts(self, poses: Poses, values: Array) -> Array:
        F = self.functions(poses, values[..., 0])
        return np.asarray(F @ _table(values, F))

    def response(self, poses: Poses, values: Array) -> Array:
        F = self.functions(poses, values[..., 0])
        table = _table(values, F)
        slope = self.slopes(poses, values[..., 0]) @ table
        f, b = table.shape[-2:]
        each = F[..., None, :, None] * np.eye(b)[:, None, :]
        return np.concatenate([slope[..., None], each.reshape(*slope.shape, f * b)], axis=-1)

    @property
    def carrier(self) -> Effect:
        """The linear effect with the b directions and all functions one."""
        acts = next(kind for kind in _DISPLACING if isinstance(self, kind))
        fixed = {field.name: getattr(self, field.name) for field in fields(acts)}
        unknowns = self.amplitudes[: self.direction_count]
        return acts(**fixed | {"own": unknowns, "allowance": None})


def _table(values: Array, F: Array) -> Array:
    """Amplitudes by function and direction, shape (..., f, b)."""
    return values[..., 1:].reshape(*values.shape[:-1], F.shape[-1], -1)


def amounts_of(effect: Effect) -> tuple[Parameter, ...]:
    """Its parameters but for its tuning."""
    return effect.amplitudes if isinstance(effect, Tuned) else effect.parameters


def at_rest(effect: Effect, values: Array) -> bool:
    """Whether an effect does nothing at values (..., p): a tuning alone moves nothing."""
    return not (values[..., 1:] if isinstance(effect, Tuned) else values).any()


def amid(effect: Effect, poses: Poses) -> Effect:
    """The effect, a tuned one in the middle of what is worth trying at these poses."""
    grid = effect.grid(poses) if isinstance(effect, Tuned) else ()
    if not isinstance(effect, Tuned) or not len(grid):
        return effect
    return effect.tuned(grid[len(grid) // 2])
