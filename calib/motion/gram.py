"""Products of all columns by run and joint: every fit, fold and error follows from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import steiner, transformed
from calib.arm.statics import Payload
from calib.arrays import Array, IntArray
from calib.errors import CalibError
from calib.motion.effects import JointMotion, MotionEffect, Stated
from calib.motion.filtering import CUTOFF, SLOW, Samples, filtered
from calib.motion.motions import Motions
from calib.motion.regressor import PER_LINK, nominal_inertials, regressor

Term: TypeAlias = tuple[str, float]
"""A kind of effect and its variant."""
LOSSES = ("viscous_friction", "coulomb_friction", "armature")
"""Kinds that a robot's file has, in the order of its losses."""
FILE, CURVE = -1.0, -2.0
"""Variants of a loss: its first parameter alone, as a file has it, and what shapes it alone."""
_CHUNK = 20_000  # rows at a time


@dataclass(frozen=True)
class Columns:
    """Where the columns of one joint stand: inertials (10 n), the terms, the measured effort last.

    terms : for each joint, the terms that can act there and their places
    """

    inertials: int
    terms: tuple[Mapping[Term, slice], ...]
    width: int

    def of(self, joint: int, term: Term) -> IntArray:
        """Places of a term's columns at a joint."""
        own = self.terms[joint][term]
        return np.arange(own.start, own.stop)

    def variants(self, joint: int, kind: str) -> list[Term]:
        """Terms of a kind at a joint, whole."""
        return [term for term in self.terms[joint] if term[0] == kind and term[1] >= 0.0]


@dataclass(frozen=True, eq=False)
class Products:
    """``X^T X`` of every part and joint; the last row and column are the measured effort's.

    Parts are runs; where these are few, stretches of them, several of which are left out together.

    fold : ndarray of int, shape (r,), what is left out together
    nominal : ndarray, shape (n, K), torque by the robot's file as a combination of each joint's columns
    G : ndarray, shape (r, n, K, K); moving : the same of samples at which the joint moves
    counts : ndarray, shape (r, n), samples
    noise : ndarray, shape (r, n), deviation of the effort's white noise behind the filter
    """

    robot: Robot
    columns: Columns
    nominal: Array
    names: tuple[str, ...]
    fold: IntArray
    G: Array
    moving: Array
    counts: Array
    noise: Array

    def take(self, runs: IntArray | list[int]) -> Products:
        """Those of some runs."""
        index = np.asarray(runs, dtype=int)
        parts = (self.fold, self.G, self.moving, self.counts, self.noise)
        names = tuple(self.names[i] for i in index.tolist())
        return Products(
            self.robot, self.columns, self.nominal, names, *(own[index] for own in parts)
        )

    @property
    def folds(self) -> list[int]:
        """What is left out in turn."""
        return [int(f) for f in np.unique(self.fold)]

    def parted(self, fold: int) -> tuple[Products, Products]:
        """All but a fold, and the fold."""
        out = self.fold == fold
        return self.take(np.flatnonzero(~out)), self.take(np.flatnonzero(out))

    @property
    def in_stretches(self) -> bool:
        """Whether parts are stretches of few runs."""
        return len(set(self.names)) < len(self.names)

    @cached_property
    def total(self) -> Array:
        """Over all runs, shape (n, K, K)."""
        return np.asarray(self.G.sum(axis=0))

    @property
    def power(self) -> Array:
        """Mean square of the effort of each joint, shape (n,)."""
        return np.asarray(self.total[:, -1, -1] / self.counts.sum(axis=0))


def columns_of(robot: Robot, kinds: tuple[type[MotionEffect], ...], stated: Stated) -> Columns:
    """The places of all columns."""
    begin = inertials = PER_LINK * robot.dof
    terms = []
    for joint in range(robot.dof):
        at, own = begin, {}
        for kind in kinds:
            if stated.has(kind.needs, robot.joints[joint]):
                for variant in kind.variants:
                    own[kind.kind, variant] = slice(at, at + len(kind.unknowns))
                    at += len(kind.unknowns)
                if kind.kind in LOSSES:
                    first = at - len(kind.unknowns)
                    own[kind.kind, FILE] = slice(first, first + 1)
                    own[kind.kind, CURVE] = slice(first + 1, at)
        terms.append(own)
    width = max(max((s.stop for s in own.values()), default=begin) for own in terms) + 1
    return Columns(inertials, tuple(terms), width)


def products(
    robot: Robot,
    motions: Motions,
    kinds: tuple[type[MotionEffect], ...],
    *,
    gravity: Array,
    stated: Stated,
    payload: Payload | None = None,
    cutoff: float = CUTOFF,
    stretch: float | None = None,
    left_out: float = np.inf,
) -> Products:
    """The products of every run, filtered.

    stretch : s, of the parts of runs; None for whole runs
    left_out : s, of what is left out together, at least a stretch; whole runs by default

    Raises CalibError where nothing moves.
    """
    columns = columns_of(robot, kinds, stated)
    links = carried(robot, nominal_inertials(robot), payload).ravel()
    nominal = np.tile(np.pad(links, (0, columns.width - len(links))), (robot.dof, 1))
    if robot.losses is not None:
        for j, losses in enumerate(robot.losses.tolist()):
            for kind, loss in zip(LOSSES, losses, strict=True):
                if loss:
                    nominal[j, columns.of(j, (kind, FILE))] += loss
    by_kind = {kind.kind: kind for kind in kinds}
    parts, names, fold = list[tuple[Array, ...]](), list[str](), list[int]()
    for run in motions.runs:
        samples = filtered(run, cutoff)
        if not len(samples):
            continue
        lasted = float(samples.time[-1] - samples.time[0])
        count = 1 if stretch is None else max(2, int(lasted / stretch))
        edges = np.linspace(0, len(samples), count + 1).astype(int).tolist()
        names += [run.name] * count
        own = 1 if left_out > lasted else max(2, int(lasted / left_out))
        fold += [max(fold, default=-1) + 1 + k * own // count for k in range(count)]
        parts += _products(robot, samples, edges, columns, links, by_kind, gravity, stated)
    if not parts:
        raise CalibError(f"no joint moves faster than {SLOW:g} rad/s or m/s in any run")
    G, moving, counts, noise = (np.array(own) for own in zip(*parts, strict=True))
    return Products(robot, columns, nominal, tuple(names), np.array(fold), G, moving, counts, noise)


def carried(robot: Robot, links: Array, payload: Payload | None) -> Array:
    """Inertial parameters (n, 10) with a payload, a point of mass, on the last joint's link."""
    if payload is None or not payload.mass:
        return links
    k = robot.parents[robot.tip_frame - 1]
    c = transformed(robot.origins[robot.tip_frame - 1], np.array(payload.com))
    about = payload.mass * steiner(c)
    own = np.array([1.0, *c]) * payload.mass
    links = links.copy()
    links[k - 1] += np.concatenate([own, about[np.triu_indices(3)]])
    return links


def _products(
    robot: Robot,
    samples: Samples,
    edges: Sequence[int],
    columns: Columns,
    links: Array,
    kinds: Mapping[str, type[MotionEffect]],
    gravity: Array,
    stated: Stated,
) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Of every part of a run: products, those of what moves, counts, and the noise."""
    n, K, chunks = robot.dof, columns.width, range(0, len(samples), _CHUNK)

    @lru_cache(maxsize=1)  # a run of one chunk needs its rows twice
    def rows(begin: int, end: int) -> Array:
        own = slice(begin, end)
        return regressor(robot, samples.q[own], samples.v[own], samples.a[own], gravity)

    rigid = np.concatenate([rows(i, min(i + _CHUNK, len(samples))) @ links for i in chunks])
    joints = [JointMotion.of(samples, rigid, robot, j, stated) for j in range(n)]
    local = _terms(joints, samples, columns, kinds)
    for first, last in pairwise(edges):
        G, moving = np.zeros((2, n, K, K))
        for begin in range(first, last, _CHUNK):
            own = slice(begin, min(begin + _CHUNK, last))
            Y = rows(own.start, own.stop)
            for j in range(n):
                X = np.concatenate([Y[:, j], local[j][own]], axis=1)
                fast = X[np.abs(samples.v[own, j]) > SLOW]
                G[j], moving[j] = G[j] + X.T @ X, moving[j] + fast.T @ fast
        yield G, moving, np.full(n, float(last - first)), samples.noise


def _terms(
    joints: Sequence[JointMotion],
    samples: Samples,
    columns: Columns,
    kinds: Mapping[str, type[MotionEffect]],
) -> list[Array]:
    """Columns of all terms of each joint, and its effort, (m, K - 10 n)."""
    found = []
    for j, (joint, terms) in enumerate(zip(joints, columns.terms, strict=True)):
        own = np.zeros((len(samples), columns.width - columns.inertials))
        for (kind, variant), place in terms.items():
            if variant < 0.0:
                continue
            at = slice(place.start - columns.inertials, place.stop - columns.inertials)
            found_columns = kinds[kind](variant).columns(joint)
            sharp = kinds[kind].sharp
            own[:, at] = samples.smoothed(found_columns) if sharp else found_columns
        own[:, -1] = samples.effort[:, j]
        found.append(own)
    return found
