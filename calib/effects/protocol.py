"""An effect is anything that moves a marker. It is linear in its parameters where it acts.

An effect acts on the paper's product ``T_base T_robot T_tool`` (equation 6) in one of these ways:

- :class:`TwistEffect` displaces frames of the arm by ``xi = basis @ parameters``. A :class:`Constant`
  does so alike at every pose. A :class:`PoseEffect` uses what is known of the pose before the arm
  bends: angles as read, approach, time, temperature. A :class:`FrameEffect` displaces one frame.
- :class:`ElasticEffect` is a twist by a flexibility times the wrench that the frame transmits,
  ``xi = K(parameters) w`` (equation 2 with the terms of k_theta that it stands for).
- :class:`LoadEffect` adds to the wrench that frames transmit, and so moves what is elastic. A
  :class:`~calib.effects.loads.SpringEffect` acts beside a joint, a :class:`WeightEffect` by what hangs
  on the arm.
- The two kinds of :mod:`calib.effects.tool_base` are the outer factors.
- The kinds of :mod:`calib.effects.readings` displace a marker, a reading, or a part of an instrument.

:mod:`calib.model` derives the exact displacement, its Jacobian and its score from the basis. An effect
with one parameter that is not linear is a :class:`~calib.effects.tuned.Tuned`. A new cause of error is
one such class and one entry in ``calib.effects.EFFECTS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np

from calib.arm.kinematics import Frames
from calib.arm.statics import Loads, Transmitted
from calib.arrays import Array
from calib.effects.context import ARM, Context, Expectation
from calib.errors import EffectCannotAct
from calib.poses import Poses

_SI = {
    "nm": 1e-9, "um": 1e-6, "mm": 1e-3, "urad": 1e-6, "mrad": 1e-3, "ppm": 1e-6,
    "min": 60.0, "h": 3600.0,
}  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One unknown of the model.

    effect, where, name : str, as in the effect table of the file formats
    unit : str, in which people read it
    scale : float, SI per unit
    size : float, SI, a plausible magnitude that scales columns
    largest : float or None, SI, beyond which such an error is far out; ten plausible sizes where None
    """

    effect: str
    where: str
    name: str
    unit: str
    scale: float
    size: float
    largest: float | None = None

    @property
    def key(self) -> tuple[str, str, str]:
        """Effect, where and name, which are unique in a model."""
        return self.effect, self.where, self.name

    @property
    def limit(self) -> float:
        """Magnitude beyond which such an error is seldom met, SI."""
        return 10.0 * self.size if self.largest is None else self.largest

    @property
    def id(self) -> str:
        """Name that is unique in a model, ``effect:where.name``."""
        return f"{self.effect}:{self.where}.{self.name}"


Unknown: TypeAlias = tuple[str, str, float] | tuple[str, str, float, float]
"""A parameter to be: name, unit, plausible size and, where it is not ten of these, largest one, SI."""


@dataclass(frozen=True, eq=False)
class State:
    """What bases may depend on, at the present displacement of the arm."""

    poses: Poses
    frames: Frames
    wrench: Transmitted


@dataclass(frozen=True, eq=False)
class Effect(ABC):
    """One cause at one place, ``where``.

    unknowns : its parameters, where they are the same at every place
    allowance : None, or for a candidate how many times the limits of its parameters stand for one
        standard deviation a priori
    uses : what it needs of each pose beyond joints and loads, by the names of ``Poses``; where a pose
        does not have that, the effect does nothing
    parts : kinds of effects that it contains, at the same place
    """

    where: str
    allowance: float | None = field(default=None, kw_only=True)
    kind: ClassVar[str]
    unknowns: ClassVar[tuple[Unknown, ...]] = ()
    uses: ClassVar[tuple[str, ...]] = ()
    parts: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        """Every place where this effect can act on the robot at hand."""

    @classmethod
    @abstractmethod
    def at(cls, context: Context, where: str) -> Effect:
        """The effect at one of its places, with the parameters that ``context.parameters`` names."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its unknowns, in the order of the basis columns."""
        return tuple(self.parameter(*unknown) for unknown in self.unknowns)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        """How often, and how large, it is met at a place of the robot at hand."""
        return Expectation()

    def forms(self, poses: Poses) -> tuple[Effect, ...]:
        """Further forms of the same cause, that a diagnosis of these poses tries."""
        return ()

    def contains(self, kind: str, where: str) -> bool:
        """Whether another cause is a part of this one, so that a model needs it no more."""
        return kind in self.parts and where == self.where

    @property
    def depends_on(self) -> str:
        """On what its displacement depends most, as named in the results."""
        if not self.uses:
            return "none"
        first = self.uses[0]
        return f"{first}:{self.where}" if first in ("approach", "motion") else first

    @property
    def initial(self) -> Array:
        """Values at which it does nothing and a search begins, shape (p,), SI."""
        return np.zeros(len(self.parameters))

    def parameter(
        self, name: str, unit: str, size: float, largest: float | None = None
    ) -> Parameter:
        """One of its unknowns; size and largest in SI."""
        top, _, per = unit.partition("/")
        scale = _SI.get(top, 1.0) / _SI.get(per, 1.0)
        return Parameter(self.kind, self.where, name, unit, scale, size, largest)


Twist: TypeAlias = tuple[int, Array]
"""A frame (0 base, 1..n joints, n + 1 tip) and d xi / d parameter there, (..., m or 1, 6, p), SI."""

Displacement: TypeAlias = tuple[int, Array]
"""A frame and its displacement xi, (..., m or 1, 6), SI."""

Flexibilities: TypeAlias = Mapping[tuple[int, int], Array]
"""D K / d parameter, (m or 1, 6, 6, p), by frames: the displaced one, and that whose wrench does it."""


def displaced(twists: Sequence[Twist], values: Array) -> tuple[Displacement, ...]:
    """Displacements ``basis @ values`` by what is linear; values (..., p), SI."""
    theta = values[..., None, :]
    return tuple((f, np.einsum("...ip,...p->...i", basis, theta)) for f, basis in twists)


@dataclass(frozen=True, eq=False)
class DirectedEffect(Effect):
    """Displaces something along b constant directions by amounts that follow from the pose.

    By itself it is no cause by name: it displaces by the same amounts at every pose.

    own : tuple of Parameter, these amounts
    """

    own: tuple[Parameter, ...] = field(default=(), kw_only=True)
    kind: ClassVar[str] = "steady"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ()

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        raise EffectCannotAct(f"{cls.kind}:{where}", "it is no cause by name", "name another")

    @property
    @abstractmethod
    def direction_count(self) -> int:
        """How many directions, b."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.own or super().parameters

    def response(self, poses: Poses, values: Array) -> Array:
        """D amounts / d value at values (..., p), shape (..., m, b, p)."""
        p = len(self.own)
        return np.broadcast_to(np.eye(p), (len(poses), p, p))

    def amounts(self, poses: Poses, values: Array) -> Array:
        """By how much each direction is displaced at values (..., p), shape (..., m, b), SI."""
        return np.asarray((self.response(poses, values) @ values[..., None, :, None])[..., 0])


@dataclass(frozen=True, eq=False)
class TwistEffect(Effect):
    """Displaces frames of the arm, each in its own axes."""

    @abstractmethod
    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        """Where it acts, and how at values (..., p)."""


@dataclass(frozen=True, eq=False)
class Constant(TwistEffect):
    """A displacement that is the same at every pose: it can go into the joint origins of a URDF."""

    frame: int

    @property
    @abstractmethod
    def columns(self) -> Array:
        """D xi / d parameter, shape (6, p), SI."""

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return ((self.frame, self.columns[None]),)


@dataclass(frozen=True, eq=False)
class PoseEffect(TwistEffect):
    """A displacement by what is known of the pose before the arm bends, angles as read."""

    @abstractmethod
    def twists_at(self, poses: Poses, values: Array) -> tuple[Twist, ...]:
        """Where it acts, and how at values (..., p), which count only where it is not linear."""

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return self.twists_at(state.poses, values)

    def displacements(self, poses: Poses, values: Array) -> tuple[Displacement, ...]:
        """By how much it displaces which frames at values (..., p)."""
        return displaced(self.twists_at(poses, values), values)

    @property
    def depends_on(self) -> str:
        if self.uses:
            return super().depends_on
        return "load" if self.where == ARM else f"q:{self.where}"


@dataclass(frozen=True, eq=False)
class DirectedTwist(DirectedEffect, PoseEffect):
    """Displaces frames along constant directions."""

    @property
    @abstractmethod
    def along(self) -> tuple[Twist, ...]:
        """The frames and their directions, (6, b), each in its own axes."""

    @property
    def direction_count(self) -> int:
        return int(self.along[0][1].shape[1])

    def twists_at(self, poses: Poses, values: Array) -> tuple[Twist, ...]:
        response = self.response(poses, values)
        return tuple((frame, directions @ response) for frame, directions in self.along)

    def displacements(self, poses: Poses, values: Array) -> tuple[Displacement, ...]:
        amounts = self.amounts(poses, values)
        return tuple((frame, amounts @ directions.T) for frame, directions in self.along)


@dataclass(frozen=True, eq=False)
class FrameEffect(DirectedTwist):
    """Displaces one frame.

    frame : int; directions : ndarray, shape (6, b), in the frame's axes
    """

    frame: int
    directions: Array

    @property
    def along(self) -> tuple[Twist, ...]:
        return ((self.frame, self.directions),)


@dataclass(frozen=True, eq=False)
class StretchEffect(DirectedTwist):
    """Makes links longer, all in the same proportion: one direction.

    ends : tuple of int, the frames in which these links end
    lengths : ndarray, shape (ends, 3), m, the links' translations in the axes of those frames
    """

    ends: tuple[int, ...]
    lengths: Array

    @property
    def along(self) -> tuple[Twist, ...]:
        links = np.pad(self.lengths, ((0, 0), (0, 3)))[..., None]
        return tuple(zip(self.ends, links, strict=True))


@dataclass(frozen=True, eq=False)
class ElasticEffect(TwistEffect):
    """A displacement in proportion to the wrench that frames transmit."""

    frame: int

    @property
    def depends_on(self) -> str:
        return "load"

    @abstractmethod
    def flexibilities(self, poses: Poses) -> Flexibilities:
        """``xi_k = sum_j K_kj (force, moment)_j``, by frames (k, j), each in its own axes."""

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return tuple(
            (moved, _by_wrench(K, state.wrench.local[..., stressed, :]))
            for (moved, stressed), K in self.flexibilities(state.poses).items()
        )


def _by_wrench(K: Array, local: Array) -> Array:
    """D xi / d parameter by the wrench of a frame (..., m, 6), shape (..., m, 6, p), SI."""
    return np.asarray(np.einsum("mijp,...mj->...mip", K, local))


@dataclass(frozen=True, eq=False)
class LoadEffect(Effect):
    """Adds a wrench to what the frames transmit."""

    @property
    def depends_on(self) -> str:
        return super().depends_on if self.uses else "load"


@dataclass(frozen=True, eq=False)
class WeightEffect(LoadEffect):
    """A change of what hangs on the arm. Its wrench follows the arm as all loads do."""

    @abstractmethod
    def changes(self, poses: Poses, loads: Loads) -> tuple[Loads, ...]:
        """D loads / d parameter, one each, from the loads as given."""
