"""Products of all columns, run by run and joint by joint: every fit, fold and error follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.motion.effects import MotionEffect, MotionState
from calib.motion.filtering import CUTOFF, SLOW, Samples, filtered
from calib.motion.motions import Motions
from calib.motion.regressor import PER_LINK, nominal_inertials, regressor

Term: TypeAlias = tuple[str, float]
"""A kind of effect and its variant."""
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
        """Terms of a kind at a joint."""
        return [term for term in self.terms[joint] if term[0] == kind]


@dataclass(frozen=True, eq=False)
class Products:
    """``X^T X`` of every run and joint; the last row and column are the measured effort's.

    G : ndarray, shape (r, n, K, K); moving : the same of samples at which the joint moves
    counts, moved : ndarray, shape (r, n), samples of both
    noise : ndarray, shape (r, n), deviation of the effort's white noise behind the filter
    """

    robot: Robot
    columns: Columns
    nominal: Array
    names: tuple[str, ...]
    G: Array
    moving: Array
    counts: Array
    moved: Array
    noise: Array

    def take(self, runs: IntArray | list[int]) -> Products:
        """Those of some runs."""
        index = np.asarray(runs, dtype=int)
        parts = (self.G, self.moving, self.counts, self.moved, self.noise)
        names = tuple(self.names[i] for i in index.tolist())
        return Products(
            self.robot, self.columns, self.nominal, names, *(own[index] for own in parts)
        )

    @cached_property
    def total(self) -> Array:
        """Over all runs, shape (n, K, K)."""
        return np.asarray(self.G.sum(axis=0))

    @property
    def power(self) -> Array:
        """Mean square of the effort of each joint, shape (n,)."""
        return np.asarray(self.total[:, -1, -1] / self.counts.sum(axis=0))


def columns_of(
    robot: Robot, kinds: tuple[type[MotionEffect], ...], ratios: Mapping[str, float]
) -> Columns:
    """The places of all columns."""
    begin = inertials = PER_LINK * robot.dof
    terms = []
    for joint in range(robot.dof):
        at, own = begin, {}
        for kind in kinds:
            if kind.acts(robot, dict(ratios), joint):
                for variant in kind.variants:
                    own[kind.kind, variant] = slice(at, at + len(kind.unknowns))
                    at += len(kind.unknowns)
        terms.append(own)
    width = max((max((s.stop for s in own.values()), default=begin) for own in terms)) + 1
    return Columns(inertials, tuple(terms), width)


def products(
    robot: Robot,
    motions: Motions,
    kinds: tuple[type[MotionEffect], ...],
    *,
    gravity: Array,
    ratios: Mapping[str, float],
    cutoff: float = CUTOFF,
    blocks: int = 1,
) -> Products:
    """The products of every run, filtered; of each so many blocks of time where ``blocks`` are asked."""
    columns, nominal = columns_of(robot, kinds, ratios), nominal_inertials(robot).ravel()
    by_kind = {kind.kind: kind for kind in kinds}
    parts, names = [], []
    for run in motions.runs:
        samples = filtered(run, cutoff)
        edges = np.linspace(0, len(samples), blocks + 1).astype(int)
        for k, (begin, end) in enumerate(zip(edges, edges[1:], strict=False)):
            names.append(run.name if blocks == 1 else f"{run.name} {k + 1}/{blocks}")
            parts.append(_products(robot, samples, slice(begin, end), columns, nominal, by_kind,
                                   gravity, dict(ratios)))  # fmt: skip
    G, moving, counts, moved, noise = (np.array(own) for own in zip(*parts, strict=True))
    return Products(robot, columns, nominal, tuple(names), G, moving, counts, moved, noise)


def _products(
    robot: Robot,
    samples: Samples,
    block: slice,
    columns: Columns,
    nominal: Array,
    kinds: Mapping[str, type[MotionEffect]],
    gravity: Array,
    ratios: dict[str, float],
) -> tuple[Array, Array, Array, Array, Array]:
    """Products of a block of a run, of what moves of it, both counts, and the noise."""
    n, K = robot.dof, columns.width
    chunks = [slice(i, i + _CHUNK) for i in range(0, len(samples), _CHUNK)]
    Y = [
        regressor(robot, samples.q[c], samples.v[c], samples.a[c], gravity)
        for c in chunks[: 1 if len(chunks) == 1 else 0]
    ]

    def rows(c: slice) -> Array:
        return Y[0] if Y else regressor(robot, samples.q[c], samples.v[c], samples.a[c], gravity)

    rigid = np.concatenate([rows(c) @ nominal for c in chunks])
    state = MotionState(robot, samples, rigid, ratios)
    local = [
        np.column_stack([
            *(kinds[kind].columns(state, j, variant) for kind, variant in columns.terms[j]),
            *([np.zeros((len(samples), 1))] * (K - 1 - max(
                (s.stop for s in columns.terms[j].values()), default=columns.inertials))),
            samples.effort[:, j],
        ])
        for j in range(n)
    ]  # fmt: skip
    G, moving = np.zeros((2, n, K, K))
    counts, moved = np.zeros((2, n))
    inside = np.zeros(len(samples), dtype=bool)
    inside[block] = True
    for c in chunks:
        Y_c = rows(c)
        for j in range(n):
            X = np.concatenate([Y_c[:, j], local[j][c]], axis=1)[inside[c]]
            fast = np.abs(samples.v[c, j][inside[c]]) > SLOW
            G[j] += X.T @ X
            moving[j] += X[fast].T @ X[fast]
            counts[j] += len(X)
            moved[j] += fast.sum()
    return G, moving, counts, moved, samples.noise
