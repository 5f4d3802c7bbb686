"""A robot's file as links that hang on joints, whatever its form, and the arm between some of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.arm.robot import Capsule, Place, Robot, Shapes, Source
from calib.arm.se3 import steiner, transformed
from calib.arm.ties import Coupling, moves_itself
from calib.arrays import Array
from calib.errors import InputError
from calib.files.shapes import enclosing_capsule

_MOVING = ("revolute", "continuous", "prismatic")
_SHOWN = 12  # names that a message lists
_NAMELESS = "\0"  # begins the key of a link that the file gives no name
Shape: TypeAlias = tuple[Array, float]
"""Points (n, 3), m, in the frame of a link, and a radius [m] about them."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a file; SI.

    kind : revolute, continuous, prismatic, fixed, or any other that the file may have
    origin : ndarray, shape (4, 4), m, its frame in that of the parent; once moved, it is the child's
    axis : ndarray, shape (3,), of any length; limits : infinite where there are none
    effort, speed : NaN where none is given
    mimic : the master, the factor and the offset of a joint that follows another
    losses : damping, friction and armature
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array = field(default_factory=lambda: np.eye(3)[0])
    limits: tuple[float, float] = (-math.inf, math.inf)
    effort: float = math.nan
    speed: float = math.nan
    mimic: tuple[str, float, float] | None = None
    losses: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def moves(self) -> bool:
        return self.kind in _MOVING


@dataclass(frozen=True, eq=False)
class Weight:
    """A link's mass [kg], centre of mass (3,), m, and inertia about it (3, 3), kg m^2, in its frame."""

    link: str
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Tree:
    """What a robot's file holds.

    source : form and files; links : their names; joints : in the order of the file
    weights : of links that have some
    shapes : what touches of a link; a text for what cannot be read
    ground : link of which no branches belong to the arm; called : how the form calls a link
    """

    source: Source
    name: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    weights: tuple[Weight, ...]
    shapes: Callable[[str], Iterator[Shape | str]]
    ground: str = ""
    called: str = "link"

    @property
    def path(self) -> Path:
        """The file."""
        return self.source.files[0]

    @property
    def named(self) -> list[str]:
        """Links that have a name."""
        return [link for link in self.links if not link.startswith(_NAMELESS)]

    @staticmethod
    def shown(link: str) -> str:
        """What a reader is told of a link: of one between two joints of a body, the body."""
        return link.rpartition(" of ")[2].strip(_NAMELESS) if link.startswith(_NAMELESS) else link

    @cached_property
    def below(self) -> dict[str, list[Joint]]:
        """Joints that hang on each link."""
        below: dict[str, list[Joint]] = {link: [] for link in self.links}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)
        return below

    def chain(self, base: str, tip: str, others: Sequence[str] = ()) -> list[Joint]:
        """Joints from ``base`` to ``tip``, to other links, and to joints that move any of these.

        Parents come first, and fixed joints are among them. Raises InputError where no way of joints
        leads there, or one of an unknown kind.
        """
        on = [("'on' of what it carries", other) for other in others]
        for key, name in (("[robot] base", base), ("[robot] tip", tip), *on):
            if name not in self.named:
                remedy = f"set {key} to one of: {', '.join(self.named[:_SHOWN]) or 'none'}"
                raise InputError(self.path, "", f"has no {self.called} {name!r}", remedy)
        chain = list(dict.fromkeys(j for end in (tip, *others) for j in self._way(base, end)))
        for joint in chain:  # grows
            if joint.moves and joint.mimic is not None:
                way = self._way(base, self._master(joint).child)
                chain += [own for own in way if own not in chain]
            where = f"joint {joint.name or joint.child.strip(_NAMELESS)}"
            if not joint.moves and joint.kind != "fixed":
                remedy = "use joints that turn or slide about one axis, or are fixed"
                what = f"type {joint.kind!r} is not supported"
                raise InputError(self.path, where, what, remedy)
            if joint.moves and not joint.name:
                raise InputError(self.path, where, "has no name", "name it as the data do")
        if not any(joint.moves for joint in chain):
            remedy = "check [robot] base and tip"
            raise InputError(self.path, "", "the chain has no moving joint", remedy)
        return chain

    def _way(self, base: str, tip: str) -> list[Joint]:
        """Joints of the only way from one link down to another."""
        by_child = {joint.child: joint for joint in self.joints}
        way: list[Joint] = []
        link = tip
        while link != base:
            if link not in by_child or len(way) > len(by_child):
                what = f"no chain of joints leads from {base!r} to it (stopped at {link!r})"
                remedy = "check [robot] base and tip"
                raise InputError(self.path, f"{self.called} {tip}", what, remedy)
            way.insert(0, by_child[link])
            link = by_child[link].parent
        return way

    def places(self, base: str, chain: Sequence[Joint]) -> dict[str, Place]:
        """Where every link of the arm is; joints beside the chain, of any kind, are at zero."""
        places: dict[str, Place] = {base: (0, np.eye(4))}
        moving = 0
        for joint in chain:
            k, T = places[joint.parent]
            moving += joint.moves
            places[joint.child] = (moving, np.eye(4)) if joint.moves else (k, T @ joint.origin)
        pending = [link for link in places if link != self.ground]
        for link in pending:  # grows as links are placed
            k, T = places[link]
            new = [joint for joint in self.below.get(link, ()) if joint.child not in places]
            places |= {joint.child: (k, T @ joint.origin) for joint in new}
            pending += [joint.child for joint in new]
        return places

    def robot(self, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
        """The arm from link ``base`` to link ``tip``, and to other links that are tips as well.

        Fixed joints are folded into the next origin. Masses and shapes that hang on a moving link by
        other joints than these are gathered into it. A joint that mimics another stays a joint of the
        robot, which its master moves; so the master is one, too.

        Raises InputError for no such way, axes without length, and numbers that contradict.
        """
        chain = self.chain(base, tip, others)
        places = self.places(base, chain)
        moving = [joint for joint in chain if joint.moves]
        names = tuple(joint.name for joint in moving)
        hung = [(*places[joint.parent], joint.origin) for joint in moving]
        hung += [(*places[link], np.eye(4)) for link in (*others, tip)]
        masses, coms, inertias = gathered(len(moving), self.weights, places)
        return Robot(
            name=self.name,
            base=base,
            tip=tip,
            joints=names,
            prismatic=np.array([joint.kind == "prismatic" for joint in moving]),
            origins=np.array([T @ origin for _, T, origin in hung]),
            axes=np.array([self._axis(joint) for joint in moving]),
            limits=self._limits(moving),
            efforts=np.array([joint.effort for joint in moving]),
            speeds=np.array([joint.speed for joint in moving]),
            masses=masses,
            coms=coms,
            inertias=inertias,
            losses=np.array([joint.losses for joint in moving]),
            couplings=self._couplings(moving),
            shapes=self._shapes(names, places),
            source=self.source,
            others=tuple(others),
            parents=tuple(k for k, _, _ in hung),
        )

    def _axis(self, joint: Joint) -> Array:
        length = float(np.linalg.norm(joint.axis))
        if length < 1e-9:
            where = f"joint {joint.name} axis"
            raise InputError(self.path, where, "has no length", "name a direction")
        return joint.axis / length

    def _master(self, joint: Joint) -> Joint:
        """What a joint mimics. Raises InputError."""
        name, factor, _ = joint.mimic or ("", 0.0, 0.0)
        master = next((own for own in self.joints if own.name == name), None)
        if master is None or not master.moves or not factor:
            what = f"mimics {name!r}, which is no joint that moves it"
            remedy = "correct its <mimic>, or write it as a fixed joint"
            raise InputError(self.path, f"joint {joint.name}", what, remedy)
        return master

    def _couplings(self, moving: Sequence[Joint]) -> tuple[Coupling, ...]:
        """Joints that mimic others. Raises InputError for one that mimics itself."""
        mimics = [(joint.name, *joint.mimic) for joint in moving if joint.mimic is not None]
        couplings = tuple(Coupling(name, ((of, by),), shift) for name, of, by, shift in mimics)
        if joint := moves_itself(couplings):
            remedy = "let one of its masters move freely"
            raise InputError(self.path, f"joint {joint}", "mimics itself", remedy)
        return couplings

    def _limits(self, moving: Sequence[Joint]) -> Array:
        """Limits (n, 2) of joints. Raises InputError."""
        for joint in moving:
            low, high = joint.limits
            if low > high:
                where = f"joint {joint.name} limit"
                raise InputError(self.path, where, f"lower {low} is above upper {high}")
        return np.array([joint.limits for joint in moving])

    def _shapes(self, joints: Sequence[str], places: dict[str, Place]) -> Shapes:
        """A capsule about each shape of the arm, by the joint that carries it, or ``base``."""
        capsules: dict[str, tuple[Capsule, ...]] = {}
        unread: list[str] = []
        for link, (k, T) in places.items():
            name = ("base", *joints)[k]
            for shape in self.shapes(link):
                if isinstance(shape, str):
                    unread.append(shape)
                    continue
                points, radius = shape
                start, end, wide = enclosing_capsule(transformed(T, points))
                (a, b, c), (d, e, f) = start.tolist(), end.tolist()
                capsule = Capsule((a, b, c), (d, e, f), wide + radius)
                capsules[name] = (*capsules.get(name, ()), capsule)
        return Shapes(capsules, tuple(unread), own=bool(capsules))


def gathered(
    count: int, weights: Sequence[Weight], places: dict[str, Place]
) -> tuple[Array, Array, Array]:
    """Mass, centre of mass and inertia about it of what each joint carries: (n,), (n, 3), (n, 3, 3)."""
    masses, moments, about = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    for weight in weights:
        k, T = places.get(weight.link, (0, np.eye(4)))
        if k > 0:
            com, R = transformed(T, weight.com), T[:3, :3]
            masses[k - 1] += weight.mass
            moments[k - 1] += weight.mass * com
            about[k - 1] += R @ weight.inertia @ R.T + weight.mass * steiner(com)
    coms = moments / np.where(masses == 0, 1.0, masses)[:, None]
    return masses, coms, about - masses[:, None, None] * steiner(coms)
