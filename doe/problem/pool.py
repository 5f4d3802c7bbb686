"""Candidate poses: drawn over the joint box or read from a file, judged by the cell's constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.cell.views import NUMBERS, looking, views_of
from calib.errors import CalibError
from calib.sobol import Sobol
from doe.constraints import Constraint, scene_of, visible
from doe.optimal.blocks import pack, packed_size
from doe.problem.levels import AngleLevels, at_level
from doe.problem.linearisation import Regressor
from doe.problem.request import Request, no_candidate

CHUNK = 2048
"""Configurations handled at once: a power of two keeps Sobol points balanced, and it fits the cache."""
_LARGEST = 8e9  # bytes of information blocks
_STEP = 1e-2  # degrees or millimetres
_WORKERS = 2
PROBE = 2000
"""Feasible configurations that are enough to know a cell by."""
_PER_LEVEL = 20
MOST_PROBED = 65_536
"""Candidates among which these are looked for."""
OUT_OF_SIGHT = "out_of_sight"
"""What removes a configuration at which no instrument reads anything."""


def rounded(cell: Cell, q: Array) -> Array:
    """Joint values (m, dof) in steps of a hundredth of a degree or millimetre, inside the limits.

    What is typed into the controller is what was judged.
    """
    step = np.where(cell.robot.prismatic, 1e-3, np.pi / 180.0) * _STEP
    low, high = cell.robot.sample_limits().T
    first, last = np.ceil(low / step - 1e-6), np.floor(high / step + 1e-6)
    inside = np.clip(np.round(q / step), first, np.maximum(first, last)) * step
    return np.where(first > last, np.clip(q, low, high), inside)


def drawn(cell: Cell, count: int, levels: AngleLevels | None, seed: int) -> Iterator[Array]:
    """Scrambled Sobol configurations in chunks, the levels in turn; count in all.

    In turn, too, they are brought to where cameras see their boards, and left for all instruments else.
    """
    low, high = cell.robot.sample_limits().T
    free = np.flatnonzero(movable(cell, levels))
    rng = np.random.default_rng(seed)
    views = NUMBERS if views_of(cell) else 0
    sampler = Sobol(len(free) + views, rng)
    for start in range(0, count, CHUNK):
        m = min(CHUNK, count - start)
        q, points = np.tile(low, (m, 1)), sampler.random(m)
        q[:, free] += points[:, : len(free)] * (high - low)[free]
        q = rounded(cell, q)
        if levels is not None:
            turn = np.arange(start, start + m) % len(levels.values)
            q[:, levels.joint] = levels.values[turn]
        yield looking_in_turn(cell, cell.robot.tied(q), points[:, len(free) :], levels, start)


def looking_in_turn(
    cell: Cell, q: Array, even: Array, levels: AngleLevels | None, start: int = 0
) -> Array:
    """Configurations (m, dof) for one camera's view after the other, and for all other instruments.

    even : ndarray, shape (m, 6), in [0, 1), how a board stands in a view; (m, 0) where there is none
    start : int, how many went before
    """
    views = views_of(cell)
    if not views:
        return q
    seeing = {view.camera.name for view in views}
    others = int(any(i.name not in seeing for i in cell.instruments))
    count = 1 if levels is None else len(levels.values)
    wanted = (np.arange(start, start + len(q)) // count) % (len(views) + others)
    viewing = wanted < len(views)
    seen = looking(cell, q, np.where(viewing, wanted, -1), even, movable(cell, levels))
    q = np.where(viewing[:, None], rounded(cell, seen), q)
    if levels is not None:
        q[:, levels.joint] = levels.values[np.arange(start, start + len(q)) % count]
    return cell.robot.tied(q)


def movable(cell: Cell, levels: AngleLevels | None) -> Mask:
    """Joints that stand at no level and follow no other, shape (dof,)."""
    at_no_level = [levels is None or k != levels.joint for k in range(cell.robot.dof)]
    return np.asarray(cell.robot.free & at_no_level)


def chunked(q: Array) -> Iterator[Array]:
    """Candidates in chunks."""
    for start in range(0, len(q), CHUNK):
        yield q[start : start + CHUNK]


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates that may be measured.

    q : ndarray, shape (n, dof), rad or m
    packed : ndarray, shape (n, p (p + 1) / 2), information of each
    level : ndarray of int, shape (n,), of each its level, zero without levels
    visible : ndarray of bool, shape (n, C), readings that can be had at each
    drawn : int, candidates before the constraints
    removed_at : dict, constraint -> ndarray of int, candidates that it removed at each level, each
        counted where it fell first
    """

    q: Array
    packed: Array
    level: IntArray
    visible: Mask
    drawn: int
    removed_at: dict[str, IntArray]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def removed(self) -> dict[str, int]:
        """Candidates that each constraint removed."""
        return {name: int(counts.sum()) for name, counts in self.removed_at.items()}

    def without(self, q: Array) -> Pool:
        """The candidates that are none of these configurations (m, dof)."""
        known = {tuple(row) for row in np.round(q, 9)}
        fresh = np.array([tuple(row) not in known for row in np.round(self.q, 9)], dtype=bool)
        removed = {**self.removed_at, "already measured": np.bincount(self.level[~fresh])}
        return replace(self.where(fresh), removed_at=removed)

    def where(self, kept: Mask) -> Pool:
        """Some of the candidates, (n,), the counts as they were."""
        own = self.packed[kept], self.level[kept], self.visible[kept]
        return Pool(self.q[kept], *own, self.drawn, self.removed_at)

    def too_few(
        self, cell: Cell, levels: AngleLevels | None, level: int, found: int, needed: int
    ) -> str:
        """Why too little is left to choose from at a level, or of all where there are no levels."""
        if levels is None:
            return no_candidate(self.drawn, self.removed, "", found, needed)
        removed = {n: int(at[level]) for n, at in self.removed_at.items() if len(at) > level}
        drawn = self.drawn // len(levels.values)
        return no_candidate(drawn, removed, at_level(cell, levels, level), found, needed)


def together(parts: Sequence[Pool], packed: Array | None = None) -> Pool:
    """Several pools as one; packed : their information where it stands together already."""
    names = dict.fromkeys(name for part in parts for name in part.removed_at)
    none = np.zeros(1, dtype=int)
    return Pool(
        np.concatenate([part.q for part in parts]),
        np.concatenate([part.packed for part in parts]) if packed is None else packed,
        np.concatenate([part.level for part in parts]),
        np.concatenate([part.visible for part in parts]),
        sum(part.drawn for part in parts),
        {name: sum((part.removed_at.get(name, none) for part in parts), none) for name in names},
    )


def judge(
    regressor: Regressor,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    q: Array,
) -> Pool:
    """Remove the candidates that may not be measured, and linearise the others."""
    cell, total, removed = regressor.cell, len(q), {}
    count = 1 if levels is None else len(levels.values)
    level = np.zeros(total, dtype=int) if levels is None else levels.of(q)
    if (level < 0).any():
        removed["levels"] = np.bincount([0] * int((level < 0).sum()), minlength=count)
        q, level = q[level >= 0], level[level >= 0]
    for constraint in constraints:
        if not len(q):
            break
        kept = constraint.allows(scene_of(cell, q))
        removed[constraint.name] = np.bincount(level[~kept], minlength=count)
        if not kept.all():
            q, level = q[kept], level[kept]
    seen = np.ones((0, len(cell.channels)), bool)
    seen = visible(scene_of(cell, q)) if len(q) else seen
    read = seen.any(axis=1)
    if not read.all():
        removed[OUT_OF_SIGHT] = np.bincount(level[~read], minlength=count)
        q, level, seen = q[read], level[read], seen[read]
    if not len(q):
        empty = np.zeros((0, packed_size(regressor.T.shape[1])))
        return Pool(q, empty, level, seen, total, removed)
    packed = pack(regressor.information(q, None if seen.all() else seen))
    return Pool(q, packed, level, seen, total, removed)


def pool_of(
    regressor: Regressor,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    chunks: Iterable[Array],
    count: int,
) -> Pool:
    """Candidates of all chunks, count in all, judged and linearised in two threads.

    Raises CalibError where their information would not fit into memory.
    """
    p = regressor.T.shape[1]
    if 8.0 * count * packed_size(p) > _LARGEST:
        most = int(_LARGEST / 8.0 / packed_size(p))
        raise CalibError(
            f"{count} candidates for {p} parameters need "
            f"{8e-9 * count * packed_size(p):.0f} GB; ask for at most {most}"
        )
    packed, parts, start = np.empty((count, packed_size(p))), [], 0
    with ThreadPoolExecutor(_WORKERS) as executor:
        for part in executor.map(partial(judge, regressor, constraints, levels), chunks):
            here = packed[start : start + len(part)]
            here[:] = part.packed
            parts.append(replace(part, packed=here))  # its own is let go at once
            start += len(part)
    return together(parts, packed[:start])


def probe_of(
    regressor: Regressor,
    constraints: tuple[Constraint, ...],
    request: Request,
    chunks: Iterable[Array],
) -> tuple[Array, Mask]:
    """Feasible candidates of every level, m of them, and their visible markers, shape (m, M).

    What the cell is like, of as many chunks as it takes. Raises CalibError where a
    level has none.
    """
    levels = request.levels
    count = 1 if levels is None else len(levels.values)
    found: list[Pool] = []
    per_level = np.zeros(count, dtype=int)
    for q in chunks:
        found.append(judge(regressor, constraints, levels, q))
        at = np.zeros(len(found[-1]), dtype=int) if levels is None else found[-1].level
        per_level += np.bincount(at, minlength=count)
        every = levels is None or not levels.chosen or per_level.min() >= _PER_LEVEL
        if per_level.sum() >= PROBE and every:
            break
    pool = together(found)
    if levels is not None and levels.chosen and count > 1 and not per_level.all():
        level = int(per_level.argmin())
        raise CalibError(pool.too_few(regressor.cell, levels, level, 0, 1))
    if not len(pool):
        raise CalibError(no_candidate(pool.drawn, pool.removed))
    return pool.q, pool.visible
