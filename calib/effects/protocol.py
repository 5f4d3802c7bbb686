"""What an effect is: anything that moves a marker, linear in its parameters where it acts.

An effect acts in one of seven ways on the paper's product ``T_base T_robot T_tool`` (equation 6):

- :class:`TwistEffect`: displaces frames of the arm by ``xi = basis @ parameters``. A
  :class:`Constant` one does so alike at every pose, a :class:`PoseEffect` by what is known of the pose
  before the arm bends: angles as read, approach, time, temperature (a :class:`FrameEffect` one frame);
- :class:`ElasticEffect`: a twist whose basis is a flexibility times the wrench that the frame
  transmits, ``xi = K(parameters) w`` (equation 2 with the terms of k_theta it stands for);
- :class:`LoadEffect`: adds to the wrench that frames transmit, and so moves what is elastic: a
  :class:`SpringEffect` beside a joint, or a :class:`WeightEffect` by what hangs on the arm;
- :class:`MarkerEffect`: displaces one marker in the tip frame;
- :class:`~calib.effects.base.Base` and :class:`~calib.effects.tool.Tool`: the outer factors;
- :class:`ReadingEffect`: the instrument reads a point elsewhere than it is, a
  :class:`RigidReading` all points of a pose as one body;
- :class:`PartEffect`: an instrument, or what it looks at, stands elsewhere or is larger than it was.

From the basis follow, in :mod:`calib.model`, the exact displacement, its Jacobian and its score. An
effect with one parameter that is not linear is a :class:`~calib.effects.tuned.Tuned`.
A new cause of error is one file with one such class and one entry in ``calib.effects.EFFECTS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple, Self, TypeAlias

import numpy as np

from calib.arm.kinematics import Frames
from calib.arm.robot import Robot
from calib.arm.se3 import displaced_shape, moved_as_one, so3_exp
from calib.arm.statics import STANDARD_GRAVITY, Loads, Payload, Transmitted
from calib.arrays import Array
from calib.errors import EffectCannotAct
from calib.instruments import TRACKER, Instrument
from calib.instruments.protocol import MOTION, SCALE
from calib.poses import Poses

ARM = "arm"
"""The place that stands for all links, or all joints, at once."""


@dataclass(frozen=True)
class Parameter:
    """One unknown of the model.

    effect, where, name : str, as in the effect table of the file formats
    unit : str, in which people read it
    scale : float, SI per unit
    size : float, SI, a plausible magnitude: scales columns
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
    def limit(self) -> float:
        """Magnitude beyond which such an error is seldom met, SI."""
        return 10.0 * self.size if self.largest is None else self.largest

    @property
    def id(self) -> str:
        """Name that is unique in a model, ``effect:where.name``."""
        return f"{self.effect}:{self.where}.{self.name}"


@dataclass(frozen=True, eq=False)
class State:
    """What bases may depend on, at the present displacement of the arm."""

    poses: Poses
    frames: Frames
    wrench: Transmitted


class Expectation(NamedTuple):
    """What is known of a cause at a place before anything is measured.

    odds : how often it is met there, beside a cause that any arm may have
    twin_odds : how often it is the cause where the readings do not tell it from another
    allowance : by how many times the usual limits such errors may be larger on this arm
    instead : why it is not asked at all, empty where it is
    """

    odds: float = 1.0
    allowance: float = 1.0
    instead: str = ""
    twin_odds: float = 1.0


class MovablePart(NamedTuple):
    """What may come loose: in how many numbers, and which markers on the tip it is, if it is there."""

    numbers: int
    body: slice | None


@dataclass(frozen=True, eq=False)
class Context:
    """What an effect may ask for when it is placed.

    robot : Robot
    markers : ndarray, shape (M, 3), m, first guesses in the tip frame
    marker_names, stations : tuple of str
    knots : dict, joint name -> ndarray, rad, where ``stiffness_vs_angle`` has coefficients
    anchors : dict, joint name -> ndarray, shape (2, 3), m: spring anchors of a gravity
        compensator, on the link before the joint and on the link after it
    gravity : ndarray, shape (3,), m/s^2, base axes
    payload : Payload, as given
    measured_load : whether the poses bring a load of their own: a wrench, or a plan's [load]
    lacking : frozenset of str, covariates that the poses in hand do not have
    clock_unit : str, of the session's clock, "s" or "reading"
    gear_ratios : dict, joint name -> float, turns of motor or wave generator a turn of the joint
    instruments : tuple of Instrument
    bodies : dict, name -> position of the first of three markers that stand for it
    """

    robot: Robot
    markers: Array
    marker_names: tuple[str, ...]
    stations: tuple[str, ...] = ("base",)
    knots: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, Array] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    payload: Payload = field(default_factory=Payload)
    measured_load: bool = False
    lacking: frozenset[str] = frozenset()
    clock_unit: str = "s"
    gear_ratios: Mapping[str, float] = field(default_factory=dict)
    instruments: tuple[Instrument, ...] = (TRACKER,)
    bodies: Mapping[str, slice] = field(default_factory=dict)

    @property
    def parts(self) -> Mapping[str, MovablePart]:
        """What may come loose of the instruments and of what they look at, by place."""
        found: dict[str, MovablePart] = {}
        for instrument in self.instruments:
            found |= {w: MovablePart(s.stop - s.start, None) for w, s in instrument.parts.items()}
            looked = (board for board in instrument.shapes if board in self.bodies)
            found |= {
                f"board:{board}": MovablePart(SCALE.stop, self.bodies[board]) for board in looked
            }
        return found

    def reads(self, kind: str) -> bool:
        """Whether there is an instrument of a kind."""
        return any(instrument.kind == kind for instrument in self.instruments)

    @property
    def single_markers(self) -> tuple[str, ...]:
        """Names of the markers that are markers of their own."""
        part = {i for own in self.bodies.values() for i in range(own.start, own.stop)}
        return tuple(name for i, name in enumerate(self.marker_names) if i not in part)


@dataclass(frozen=True, eq=False)
class Effect(ABC):
    """One cause at one place, ``where``.

    uses : what it needs to know of each pose beyond joints and loads, by the names of ``Poses``;
        where a pose does not say, the effect rests
    turns : whether its places are joints that turn, not slide
    parts : kinds of effects that it contains, at the same place
    flexible : whether at its place it can follow nearly any curve
    drawn : whether its error can be drawn as a curve over a few knots
    allowance : None, or for a suspect how many times the limits of its parameters stand for one
        standard deviation a priori
    """

    where: str
    allowance: float | None = field(default=None, kw_only=True)
    kind: ClassVar[str]
    uses: ClassVar[tuple[str, ...]] = ()
    turns: ClassVar[bool] = False
    parts: ClassVar[tuple[str, ...]] = ()
    flexible: ClassVar[bool] = False
    drawn: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        """Every place where this effect can act on the robot at hand."""

    @classmethod
    @abstractmethod
    def at(cls, context: Context, where: str) -> Effect:
        """The effect at one of its places."""

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        """How often, and how large, it is met at a place of the robot at hand."""
        return Expectation()

    @classmethod
    def repeats(cls, where: str, active: Sequence[Effect]) -> str | None:
        """Kind of the cause that it is by another name, None where it is one of its own.

        active : effects of the model beside which it is asked; empty where it would move nothing
        """
        return None

    def contains(self, kind: str, where: str) -> bool:
        """Whether another cause is a part of this one, so that a model needs it no more."""
        return kind in self.parts and where == self.where

    @property
    def depends_on(self) -> str:
        """On what its displacement depends most, as named in the results."""
        if not self.uses:
            return self.varies_with
        first = self.uses[0]
        return f"{first}:{self.where}" if first in ("approach", "motion") else first

    @property
    def varies_with(self) -> str:
        """The same of what needs no more than joints and loads."""
        return "none"

    def driven_by(self, values: Array, poses: Poses) -> str:
        """The same at fitted values (p,), where they decide it."""
        return self.depends_on

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Its unknowns, in the order of the basis columns."""

    @property
    def initial(self) -> Array:
        """Values at which it does nothing and a search begins, shape (p,), SI."""
        return np.zeros(len(self.parameters))

    @property
    def believed(self) -> Array:
        """Standard deviations, SI, of values that are known about zero beforehand; NaN where not."""
        return np.full(len(self.parameters), np.nan)

    def rests(self, values: Array) -> bool:
        """Whether it does nothing at values (..., p)."""
        return not values.any()


Twist: TypeAlias = tuple[int, Array]
"""A frame (0 base, 1..n joints, n + 1 tip) and d xi / d parameter there, (..., m or 1, 6, p), SI."""

Displacement: TypeAlias = tuple[int, Array]
"""A frame and its displacement xi, (..., m or 1, 6), SI."""


def displaced(twists: Sequence[Twist], values: Array) -> tuple[Displacement, ...]:
    """Displacements ``basis @ values`` by what is linear; values (..., p), SI."""
    theta = values[..., None, :]
    return tuple((f, np.einsum("...ip,...p->...i", basis, theta)) for f, basis in twists)


@dataclass(frozen=True, eq=False)
class DirectedEffect(Effect):
    """Displaces something along b constant directions by amounts that follow from the pose."""

    @abstractmethod
    def response(self, poses: Poses, values: Array) -> Array:
        """D amounts / d value at values (..., p), shape (..., m, b, p)."""

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
class ConstantTwist(Constant):
    """Single components of a constant displacement."""

    components: tuple[int, ...] = tuple(range(6))
    names: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")

    @property
    def columns(self) -> Array:
        return np.eye(6)[:, list(self.components)]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.kind, self.where, self.names[c], "um" if c < 3 else "urad", 1e-6, 1e-3)
            for c in self.components
        )

    def only(self, kept: tuple[int, ...]) -> Self:
        """The same with some of its parameters, given by their positions."""
        return replace(self, components=tuple(self.components[i] for i in kept))


@dataclass(frozen=True, eq=False)
class PoseEffect(TwistEffect):
    """A displacement by what is known of the pose before the arm bends, angles as read."""

    @abstractmethod
    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        """Where it acts, and how at its initial values."""

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return self.twists_at(state.poses)

    def displacements(self, poses: Poses, values: Array) -> tuple[Displacement, ...]:
        """By how much it displaces which frames at values (..., p)."""
        return displaced(self.twists_at(poses), values)

    @property
    def varies_with(self) -> str:
        return "load" if self.where == ARM else f"q:{self.where}"


@dataclass(frozen=True, eq=False)
class FrameEffect(DirectedEffect, PoseEffect):
    """Displaces one frame.

    frame : int; directions : ndarray, shape (6, b), in the frame's axes
    """

    frame: int
    directions: Array

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        return ((self.frame, self.directions @ self.response(poses, self.initial)),)

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return ((self.frame, self.directions @ self.response(state.poses, values)),)

    def displacements(self, poses: Poses, values: Array) -> tuple[Displacement, ...]:
        return ((self.frame, self.amounts(poses, values) @ self.directions.T),)


@dataclass(frozen=True, eq=False)
class ElasticEffect(TwistEffect):
    """A displacement in proportion to the wrench that the frame transmits."""

    frame: int

    @property
    def varies_with(self) -> str:
        return "load"

    @abstractmethod
    def flexibility(self, poses: Poses) -> Array:
        """D K / d parameter, shape (m or 1, 6, 6, p): xi = K (force, moment) in the frame's axes."""

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return ((self.frame, self.basis(state)),)

    def basis(self, state: State) -> Array:
        """D xi / d parameter at the frame, shape (..., m, 6, p), SI."""
        local = state.wrench.local[..., self.frame, :]
        K = self.flexibility(state.poses)
        K = np.broadcast_to(K, (len(state.poses), *K.shape[1:]))
        twists: Array = np.einsum("mijp,...mj->...mip", K, local, optimize=True)
        return twists


@dataclass(frozen=True, eq=False)
class LoadEffect(Effect):
    """Adds a wrench to what the frames transmit."""

    @property
    def varies_with(self) -> str:
        return "load"


@dataclass(frozen=True, eq=False)
class SpringEffect(LoadEffect):
    """A wrench between two links, fixed in their axes."""

    @abstractmethod
    def wrench_basis(self, poses: Poses) -> Array:
        """D w / d parameter, shape (m, n + 2, 6, p), in the axes of each frame."""


@dataclass(frozen=True, eq=False)
class WeightEffect(LoadEffect):
    """A change of what hangs on the arm; its wrench follows the arm as all loads do."""

    @abstractmethod
    def changes(self, poses: Poses, loads: Loads) -> tuple[Loads, ...]:
        """D loads / d parameter, one each, from the loads as given."""


@dataclass(frozen=True, eq=False)
class MarkerEffect(DirectedEffect):
    """Displaces one marker, ``where``, along the axes of the tip frame."""

    def marker(self, names: Sequence[str]) -> slice:
        """The marker among those of a model; none where that looks at other points."""
        own = self.where.removeprefix("marker:")
        at = list(names).index(own) if own in names else 0
        return slice(at, at + (own in names))


@dataclass(frozen=True, eq=False)
class ReadingEffect(Effect):
    """The instrument reads a point elsewhere than it is.

    of : kind of the instruments whose rows it changes
    """

    of: ClassVar[str] = "points"

    def changes(self, instrument: Instrument) -> bool:
        """Whether it changes the rows of an instrument."""
        return instrument.kind == self.of

    @property
    def varies_with(self) -> str:
        return "range" if self.of == "points" else "none"

    @abstractmethod
    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        """Readings of what is read right as rows (..., m, M, r): points in the axes of their stations.

        values : ndarray, shape (..., p), SI
        Returns readings (..., m, M, r), their derivatives by those rows (..., m or 1, M or 1, r, r) and
        by the parameters (..., m, M, r, p).
        """

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("instrument",) if context.reads(cls.of) else ()

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        return cls(where)


@dataclass(frozen=True, eq=False)
class RigidReading(DirectedEffect, ReadingEffect):
    """Moves all readings of a pose as one body, along and about the axes of their station."""

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        readings, R, rigid = moved_as_one(self.amounts(poses, values), points)
        return readings, R, rigid @ self.response(poses, values)[..., None, :, :]


@dataclass(frozen=True, eq=False)
class PartEffect(DirectedEffect):
    """Displaces a part, ``where``: an instrument, a board, a socket, from where it is found to stand.

    A camera sees everything displaced along and about its own axes; a board in the world moves and
    grows along its own, about its origin, on the tip along the tip's, about its middle; a socket moves
    along those of the base. What a 6-D instrument reads moves along and about its own axes; what a
    wire or a gauge reads grows by its zero.
    numbers : slice, those of the part that it moves: a zero, three of a shift, six of a motion, or what
        it grows by
    body : slice or None, the markers on the tip that the part is
    """

    numbers: slice
    body: slice | None

    def site(self, instrument: Instrument) -> str | None:
        """At which of an instrument's sites it acts, None for all."""
        name = self.where.partition(":")[2]
        return name if name in instrument.sites else None

    def moved(self, poses: Poses, values: Array, markers: Array) -> tuple[Array, Array, Array]:
        """Its markers (..., m, k, 3), m, tip frame, displaced about their middle.

        Returns them, what turns and scales them (..., m, 1, 3, 3), and derivatives (..., m, k, 3, p).
        """
        by = np.zeros((*values.shape[:-1], len(poses), SCALE.stop))
        by[..., self.numbers] = self.amounts(poses, values)
        middle = markers.mean(axis=-2, keepdims=True)
        placed, columns = displaced_shape(by, markers - middle)
        A = so3_exp(by[..., MOTION][..., 3:]) * (1.0 + by[..., SCALE])[..., None]
        columns = columns[..., self.numbers] @ self.response(poses, values)[..., None, :, :]
        return middle + placed, A[..., None, :, :], columns


def motion_of(part: MovablePart) -> slice:
    """The numbers of a part by which it moves without growing."""
    return slice(0, min(part.numbers, MOTION.stop))


def joint_index(context: Context, where: str) -> int:
    """Position of a joint in the chain."""
    return context.robot.joints.index(where)


def turning_joints(context: Context) -> tuple[str, ...]:
    """Names of the joints that turn."""
    robot = context.robot
    return tuple(j for j, slides in zip(robot.joints, robot.prismatic, strict=True) if not slides)


def needs(context_has: bool, effect: str, reason: str, remedy: str) -> None:
    """Refuse an effect that lacks what it needs, with EffectCannotAct."""
    if not context_has:
        raise EffectCannotAct(effect, reason, remedy)
