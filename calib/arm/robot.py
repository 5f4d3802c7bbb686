"""The nominal robot: revolute and prismatic joints in a chain, or in a tree of several tips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, get_args

import numpy as np

from calib.arm.ties import Coupling, Ties, reachable, ties_of
from calib.arrays import Array, IntArray, Mask
from calib.sobol import Sobol

Form: TypeAlias = Literal["urdf", "mjcf", "dh"]
Convention: TypeAlias = Literal["classic", "modified"]
"""Of a DH table."""
FORMS: tuple[Form, ...] = get_args(Form)
_IN_WORDS = {"urdf": "URDF", "mjcf": "MJCF", "dh": "DH table"}
_FOLLOWS = 1e-7  # rad or m
_DOUBLINGS = 8  # of configurations drawn, where a joint that others move leaves its limits
_LONGEST = 50.0  # m, of a slide; the longest tracks of robots are shorter
_MOST_TURNS = 12.0  # of a joint that is not endless
Place: TypeAlias = tuple[int, Array]
"""Where a link is: the number of the joint that carries it, 0 before the first one, and its frame
(4, 4), m, in the frame that turns with the joint, or in the base."""


@dataclass(frozen=True)
class Capsule:
    """A cylinder with round ends: start, end and radius in metres, in the frame that carries it."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Shapes:
    """The shape of the arm, as its own file or the user states it.

    capsules : dict, joint name or ``base`` or ``tool`` -> tuple of Capsule
    unread : tuple of str, shapes of the robot's file that could not be read, with the reason
    own : whether they are those of the robot's file
    """

    capsules: Mapping[str, tuple[Capsule, ...]] = field(default_factory=dict)
    unread: tuple[str, ...] = ()
    own: bool = False


@dataclass(frozen=True)
class Source:
    """The file that holds a robot.

    form : ``urdf``, ``mjcf`` or ``dh``
    files : tuple of Path, the file, and those that it includes; none where no file holds the robot
    convention : ``classic`` or ``modified``, of a DH table
    """

    form: Form = "urdf"
    files: tuple[Path, ...] = ()
    convention: Convention | None = None

    def __str__(self) -> str:
        return _IN_WORDS[self.form]


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """Joints from a base to its tips, ``T_base_tip(q) = prod_k [C_k exp(a_k q_k)] C_tip``; SI, radians.

    The product runs over the joints that carry the tip. Frames are numbered: 0 is the base, k = 1..n
    the frame of joint k before the joint moves, then one for each tip, that of ``tip`` the last. A
    chain has one tip, and each frame hangs on the one before it.

    name : str
    base, tip : str, names of the first and last link
    joints : tuple of str, the n joint names
    prismatic : ndarray of bool, shape (n,)
    origins : ndarray, shape (F - 1, 4, 4): C_1 .. C_n and those of the tips, F frames in all
    axes : ndarray, shape (n, 3), unit vectors in the joint frames
    limits : ndarray, shape (n, 2), rad or m; infinite where none is given
    efforts : ndarray, shape (n,), N m or N; NaN where no limit is given
    masses : ndarray, shape (n,), kg of the link that moves with each joint
    coms : ndarray, shape (n, 3), m, centres of mass in the frames that move with the joints
    inertias : ndarray, shape (n, 3, 3), kg m^2, about them, in the axes of these frames; or None
    losses : ndarray, shape (n, 3), damping [N m s/rad], dry friction [N m] and armature [kg m^2] of
        each joint, or with N and m; or None
    couplings : tuple of Coupling, joints that others move
    speeds, accelerations : ndarray, shape (n,), the most that the drives give, rad/s or m/s and these
        per second; NaN where none is given, None where none is at all
    shapes : Shapes; source : Source
    others : tuple of str, links that are tips beside ``tip``
    loaded : int, frame of the tip on which measured wrenches act and loads hang; that of ``tip``
        without
    parents : tuple of int, the frame on which each of the frames 1 .. F - 1 hangs, parents first; a
        chain without
    """

    name: str
    base: str
    tip: str
    joints: tuple[str, ...]
    prismatic: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    origins: Array
    axes: Array
    limits: Array
    efforts: Array
    masses: Array
    coms: Array
    inertias: Array | None = None
    losses: Array | None = None
    couplings: tuple[Coupling, ...] = ()
    speeds: Array | None = None
    accelerations: Array | None = None
    shapes: Shapes = field(default_factory=Shapes)
    source: Source = field(default_factory=Source)
    others: tuple[str, ...] = ()
    loaded: int = -1
    parents: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.parents:
            object.__setattr__(self, "parents", tuple(range(len(self.joints) + 1)))

    @classmethod
    def from_urdf(cls, path: str | Path, base: str = "", tip: str = "") -> Robot:
        """The chain between two links of a URDF, or between two bodies of an MJCF.

        base, tip : names of its ends; without them, those that ``posecal init`` would choose

        Raises InputError.
        """
        return _proposed(Path(path), base=base, tip=tip)

    from_mjcf = from_urdf

    @classmethod
    def from_dh(cls, path: str | Path, convention: Convention) -> Robot:
        """The chain of a DH table, ``joint, alpha_deg, a_mm, theta_deg, d_mm``.

        Raises InputError.
        """
        return _proposed(Path(path), convention)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.base} to {self.tip}: {', '.join(self.joints)})"

    @property
    def dof(self) -> int:
        """Number of joints, n."""
        return len(self.joints)

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of all tips, in the order of their frames."""
        return (*self.others, self.tip)

    @property
    def frame_count(self) -> int:
        """Number of frames, F: base, joints and tips."""
        return self.dof + 1 + len(self.tips)

    @property
    def tip_frame(self) -> int:
        """Number of the tip's frame, the last one."""
        return self.frame_count - 1

    @cached_property
    def carries(self) -> Mask:
        """Whether frame k carries frame f or is it, shape (F, F)."""
        found = np.eye(self.frame_count, dtype=bool)
        for frame, parent in enumerate(self.parents, 1):
            found[:, frame] |= found[:, parent]
        return found

    @property
    def branched(self) -> bool:
        """Whether some frame carries not all that come after it."""
        return len(self.tips) > 1

    def on_tip(self, markers: int) -> IntArray:
        """The frames of so many markers that all ride on the tip."""
        return np.full(markers, self.tip_frame)

    def beyond(self, joint: int) -> list[int]:
        """Positions of the joints that a joint carries, itself the first."""
        return np.flatnonzero(self.carries[joint + 1, 1 : self.dof + 1]).tolist()

    def moving(self, frame: int) -> Mask:
        """Which joints carry a frame, shape (n,)."""
        return np.asarray(self.carries[1 : self.dof + 1, frame])

    @cached_property
    def reach(self) -> float:
        """Sum of the constant translations [m] on the longest way from the first joint to a tip.

        The size of the arm, used to scale columns.
        """
        lengths = np.linalg.norm(self.origins[:, :3, 3], axis=1)
        beyond = np.array(self.parents) > 0
        ways = (self.carries[1:, tip] & beyond for tip in range(self.dof + 1, self.frame_count))
        return max(float(lengths[way].sum()) for way in ways) or 1.0

    @cached_property
    def ties(self) -> Ties:
        """What the joints are by those that may be chosen freely."""
        return ties_of(self.joints, self.couplings)

    @property
    def free(self) -> Mask:
        """Joints that may be chosen freely, shape (n,)."""
        return np.asarray(self.ties.matrix.any(axis=0))

    def shown(self, q: Array) -> dict[str, float]:
        """Joint values (n,) as people read them, by their columns: ``A1_deg``, ``rail_mm``."""
        values = np.where(self.prismatic, q * 1e3, np.degrees(q)).tolist()
        units = np.where(self.prismatic, "mm", "deg").tolist()
        return {f"{j}_{u}": round(v, 6) for j, u, v in zip(self.joints, units, values, strict=True)}

    def tied(self, q: Array) -> Array:
        """Joint values (..., n) with those that follow put where they belong."""
        return q @ self.ties.matrix.T + self.ties.shift if self.couplings else q

    def follows(self, q: Array) -> bool:
        """Whether joints that follow others stand in joint values (..., n) where these put them."""
        return bool((np.abs(self.tied(q) - q) < _FOLLOWS).all())

    @property
    def undriven(self) -> frozenset[str]:
        """Joints that others move: these tell where they are."""
        return frozenset(coupling.joint for coupling in self.couplings)

    @cached_property
    def driven(self) -> Array:
        """How far each joint goes when one drive turns by one, shape (n, n), a column for each.

        Those that it moves through couplings go with it.
        """
        by, place = np.zeros((self.dof, self.dof)), {name: k for k, name in enumerate(self.joints)}
        for coupling in self.couplings:
            for name, factor in coupling.factors:
                by[place[coupling.joint], place[name]] = factor
        return np.asarray(np.linalg.inv(np.eye(self.dof) - by))

    def moved_by(self, joint: int) -> list[int]:
        """Positions of the joints that may move one wrongly: those that move it, else all others."""
        name = self.joints[joint]
        own = next((c.factors for c in self.couplings if c.joint == name), None)
        if own is None:
            return [k for k in range(self.dof) if k != joint]
        return [self.joints.index(other) for other, _ in own]

    @classmethod
    def of_geometry(
        cls,
        name: str,
        ends: tuple[str, str],
        joints: tuple[str, ...],
        prismatic: Mask,
        origins: Array,
    ) -> Self:
        """A chain of joints about, or along, z of which neither limits nor masses are known.

        ends : names of base and tip; origins : ndarray, shape (n + 1, 4, 4)
        """
        n = len(joints)
        return cls(
            name=name,
            base=ends[0],
            tip=ends[1],
            joints=joints,
            prismatic=prismatic,
            origins=origins,
            axes=np.tile([0.0, 0.0, 1.0], (n, 1)),
            limits=np.tile([-np.inf, np.inf], (n, 1)),
            efforts=np.full(n, np.nan),
            masses=np.zeros(n),
            coms=np.zeros((n, 3)),
        )

    def sample_limits(self) -> Array:
        """Finite joint ranges, shape (n, 2): the limits, else +-pi or +-1 m.

        Within them, joints that lead keep those that follow inside theirs. A joint that follows and has
        no limits ranges as far as these move it.
        """
        fallback = np.where(self.prismatic, 1.0, np.pi)[:, None] * np.array([-1.0, 1.0])
        limits, ties = reachable(self.ties, self.limits), self.ties
        found = np.where(np.isfinite(limits), limits, fallback)
        middle, half = found.mean(axis=1), np.ptp(found, axis=1) / 2.0
        follows = ties.matrix @ middle + ties.shift, np.abs(ties.matrix) @ half
        moved = np.stack([follows[0] - follows[1], follows[0] + follows[1]], axis=1)
        open_ended = np.isinf(limits) & ~self.free[:, None]
        return np.where(open_ended, moved, found)

    def sobol(self, count: int, seed: int = 0) -> Array:
        """Joint values (count, n) of a scrambled Sobol sequence over these ranges, rad or m.

        They keep joints that several others move within their limits, where enough values do so.
        """
        low, high = self.sample_limits().T
        drawn = count
        for _ in range(_DOUBLINGS if self.couplings else 1):
            unit = Sobol(self.dof, np.random.default_rng(seed)).random(drawn)
            q = self.tied(low + unit * (high - low))
            inside = ((q >= low) & (q <= high)).all(axis=1)
            if not self.couplings or inside.sum() >= count:
                break
            drawn *= 2
        return q[inside][:count] if self.couplings and inside.sum() >= count else q[:count]


def odd_limits(robot: Robot) -> Iterator[str]:
    """What is odd about joint limits: numbers of another unit, degrees or mm; and what to do."""
    for joint, slides, (low, high) in zip(robot.joints, robot.prismatic, robot.limits, strict=True):
        wide, span = float(high - low), f"{low:g} .. {high:g}"
        if not np.isfinite(wide):
            continue
        if slides and wide > _LONGEST:
            yield (
                f"the limits of {joint}, {span} m, are too far apart for a slide: were "
                "degrees or mm written? write metres in the robot's file, or give [robot.limits_mm]"
            )
        elif not slides and wide > 2.0 * np.pi * _MOST_TURNS:
            yield (
                f"the limits of {joint}, {span} rad, are {wide / (2.0 * np.pi):.0f} turns: "
                "were degrees written? write radians in the robot's file, or give [robot.limits_deg]"
            )


def _proposed(*given: Any, **named: Any) -> Robot:
    """The robot of a file. Readers stand above the arm, so that one is found by its name."""
    robot: Robot = import_module("calib.files.robot").propose(*given, **named).robot
    return robot
