"""Candidate poses: drawn over the joint box or read from a table, judged by the cell's constraints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import CalibError
from calib.poses import Poses
from calib.sobol import Sobol
from doe.constraints import Constraint, scene_of, visible
from doe.levels import AngleLevels
from doe.views import NUMBERS, looking, views_of

CHUNK = 2048
"""Configurations handled at once: a power of two keeps Sobol points balanced, and it fits the cache."""
OUT_OF_SIGHT = "out_of_sight"
"""What removes a configuration at which no instrument reads anything."""
_STEP = 1e-2  # degrees or millimetres
WORKERS = 2
"""Threads that judge candidates."""


def rounded(cell: Cell, q: Array) -> Array:
    """Joint values (m, dof) in steps of a hundredth of a degree or millimetre, inside the limits.

    What is typed into the controller is what was judged.
    """
    step = np.where(cell.robot.prismatic, 1e-3, np.pi / 180.0) * _STEP
    low, high = cell.robot.sample_limits().T
    first, last = np.ceil(low / step - 1e-6), np.floor(high / step + 1e-6)
    inside = np.clip(np.round(q / step), first, np.maximum(first, last)) * step
    return np.where(first > last, np.clip(q, low, high), inside)


def movable(cell: Cell, levels: AngleLevels | None) -> Mask:
    """Joints that stand at no level and follow no other, shape (dof,)."""
    at_no_level = [levels is None or k != levels.joint for k in range(cell.robot.dof)]
    return np.asarray(cell.robot.free & at_no_level)


def drawn(cell: Cell, count: int, levels: AngleLevels | None, seed: int) -> Iterator[Array]:
    """Scrambled Sobol configurations in chunks, the levels in turn; count in all.

    In turn, too, they are brought to where cameras see their boards, and left for all instruments else.
    """
    low, high = cell.robot.sample_limits().T
    joints, views = movable(cell, levels), views_of(cell)
    others = {i.name for i in cell.instruments} - {view.camera.name for view in views}
    free, turns = np.flatnonzero(joints), len(views) + int(bool(others))
    sampler = Sobol(len(free) + (NUMBERS if views else 0), np.random.default_rng(seed))
    for start in range(0, count, CHUNK):
        turn = np.arange(start, min(start + CHUNK, count))
        q, points = np.tile(low, (len(turn), 1)), sampler.random(len(turn))
        q[:, free] += points[:, : len(free)] * (high - low)[free]
        q = _levelled(cell, rounded(cell, q), levels, turn)
        if views:
            wanted = turn // (1 if levels is None else len(levels.values)) % turns
            wanted = np.where(wanted < len(views), wanted, -1)
            seen = looking(cell, q, wanted, points[:, len(free) :], joints)
            q = np.where(wanted[:, None] < 0, q, rounded(cell, seen))
            q = _levelled(cell, q, levels, turn)
        yield q


def _levelled(cell: Cell, q: Array, levels: AngleLevels | None, turn: IntArray) -> Array:
    """Configurations at one level after the other."""
    if levels is not None:
        q[:, levels.joint] = levels.values[turn % len(levels.values)]
    return cell.robot.tied(q)


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates that may be measured.

    q : ndarray, shape (n, dof), rad or m; level : ndarray of int, shape (n,), zero without levels
    seen : ndarray of bool, shape (n, C), readings that can be had at each
    drawn : int, candidates before the constraints; removed_by : dict, what removed how many of them,
        each counted where it fell first
    """

    q: Array
    level: IntArray
    seen: Mask
    drawn: int
    removed_by: dict[str, int]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def feasible(self) -> int:
        """How many there are."""
        return len(self.q)

    @classmethod
    def of(
        cls,
        cell: Cell,
        constraints: tuple[Constraint, ...],
        levels: AngleLevels | None,
        q: Array,
    ) -> Pool:
        """Those of configurations (m, dof) that stand at a level, keep the constraints and are seen."""
        drawn, removed = len(q), {constraint.name: 0 for constraint in constraints}
        if levels is not None and (lost := levels.of(q) < 0).any():
            removed["levels"], q = int(lost.sum()), q[~lost]
        for constraint in constraints:
            if len(q) and not (kept := constraint.allows(scene_of(cell, q))).all():
                removed[constraint.name], q = int((~kept).sum()), q[kept]
        seen = visible(scene_of(cell, q)) if len(q) else np.ones((0, len(cell.channels)), bool)
        if not (read := seen.any(axis=1)).all():
            removed[OUT_OF_SIGHT], q, seen = int((~read).sum()), q[read], seen[read]
        level = np.zeros(len(q), dtype=int) if levels is None else levels.of(q)
        return cls(q, level, seen, drawn, removed)

    @classmethod
    def together(cls, parts: Sequence[Pool]) -> Pool:
        """Several as one."""
        names = dict.fromkeys(name for part in parts for name in part.removed_by)
        return cls(
            np.concatenate([part.q for part in parts]),
            np.concatenate([part.level for part in parts]),
            np.concatenate([part.seen for part in parts]),
            sum(part.drawn for part in parts),
            {name: sum(part.removed_by.get(name, 0) for part in parts) for name in names},
        )

    def take(self, index: IntArray | Mask | slice) -> Pool:
        """Some of the candidates."""
        return replace(self, q=self.q[index], level=self.level[index], seen=self.seen[index])

    def without(self, q: Array) -> Pool:
        """The candidates that are none of these configurations (m, dof)."""
        known = {tuple(row) for row in np.round(q, 9)}
        fresh = np.array([tuple(row) not in known for row in np.round(self.q, 9)], dtype=bool)
        return replace(
            self.take(fresh),
            removed_by={**self.removed_by, "already measured": int((~fresh).sum())},
        )

    def too_few(self, where: str = "", count: int = 0, needed: int = 1) -> CalibError:
        """Why nothing, or too little, is left to choose from."""
        what = f"no feasible candidate{where}"
        if count:
            only = f"only {count} feasible candidate{'s' if count > 1 else ''}"
            what = f"{only}{where}, and {needed} are needed"
        causes = sorted(((n, name) for name, n in self.removed_by.items() if n), reverse=True)
        if not causes:
            return CalibError(f"{what}; draw more, or allow repeats")
        said = ", ".join(f"{name} removed {n}" for n, name in causes)
        return CalibError(f"{what}: of {self.drawn}, {said}; relax what removed most")


def candidates_of(
    cell: Cell,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    source: int | Poses,
    seed: int,
) -> Pool:
    """Feasible candidates, a number of drawn ones or those of a table, judged in two threads."""
    chunks: Iterator[Array] = (
        drawn(cell, source, levels, seed)
        if isinstance(source, int)
        else (source.q[start : start + CHUNK] for start in range(0, len(source), CHUNK))
    )
    with ThreadPoolExecutor(WORKERS) as executor:
        parts = executor.map(lambda q: Pool.of(cell, constraints, levels, q), chunks)
        return Pool.together(list(parts))
