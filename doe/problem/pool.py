"""Candidate poses: drawn over the joint box or read from a file, judged by the cell's constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.cell.contacts import brought, contacts_of
from calib.cell.views import NUMBERS, looking, views_of
from calib.errors import CalibError
from calib.poses import Poses
from calib.sobol import Sobol
from doe.constraints import Constraint, scene_of, visible
from doe.constraints.scene import Clearance
from doe.day.approach import last_move
from doe.optimal.blocks import pack, packed_size
from doe.problem.choice import Choice
from doe.problem.levels import AngleLevels, at_level
from doe.problem.linearisation import Regressor
from doe.problem.request import Request, no_candidate
from doe.problem.visits import Visits, joined

CHUNK = 2048
"""Configurations handled at once: a power of two keeps Sobol points balanced, and it fits the cache."""
_LARGEST = 8e9  # bytes of information blocks
_STEP = 1e-2  # degrees or millimetres
_WORKERS = 2
_TRIED_SIDES = 8  # of each row of a table
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


def drawn(
    cell: Cell, count: int, levels: AngleLevels | None, seed: int, choice: Choice | None = None
) -> Iterator[Visits]:
    """Scrambled Sobol configurations in chunks, the levels and moments in turn; count in all.

    In turn, too, they are brought to what is touched, and to where cameras see their boards, and left
    for all instruments else.
    """
    low, high = cell.robot.sample_limits().T
    free = np.flatnonzero(movable(cell, levels))
    rng = np.random.default_rng(seed)
    views = NUMBERS if views_of(cell) else 0
    sampler = Sobol(len(free) + views + (choice.dimensions if choice else 0), rng)
    for start in range(0, count, CHUNK):
        m = min(CHUNK, count - start)
        q, points = np.tile(low, (m, 1)), sampler.random(m)
        q[:, free] += points[:, : len(free)] * (high - low)[free]
        even, move = np.split(points[:, len(free) :], [views], axis=1)
        q = rounded(cell, q)
        if levels is not None:
            turn = np.arange(start, start + m) % len(levels.values)
            q[:, levels.joint] = levels.values[turn]
        q = in_turn_brought(cell, cell.robot.tied(q), even, levels, start)
        yield choice.visits(cell, q, move, start) if choice else Visits(q)


def in_turn_brought(
    cell: Cell, q: Array, even: Array, levels: AngleLevels | None, start: int = 0
) -> Array:
    """Configurations (m, dof) for one instrument after the other: at a contact, in a view, anywhere.

    even : ndarray, shape (m, 6), in [0, 1), how a board stands in a view; (m, 0) where there is none
    start : int, how many went before
    """
    contacts, views = contacts_of(cell), views_of(cell)
    if not contacts and not views:
        return q
    seeing = {view.camera.name for view in views}
    others = int(any(not i.touches and i.name not in seeing for i in cell.instruments))
    count = 1 if levels is None else len(levels.values)
    ways = len(contacts) + len(views)
    wanted = (np.arange(start, start + len(q)) // count) % (ways + others)
    free = movable(cell, levels)
    q = brought(cell, q, np.where(wanted < len(contacts), wanted, -1), free)
    if views:
        viewing = (wanted >= len(contacts)) & (wanted < ways)
        seen = looking(cell, q, np.where(viewing, wanted - len(contacts), -1), even, free)
        q = np.where(viewing[:, None], rounded(cell, seen), q)
        if levels is not None:
            q[:, levels.joint] = levels.values[np.arange(start, start + len(q)) % count]
        q = cell.robot.tied(q)
    return q


def movable(cell: Cell, levels: AngleLevels | None) -> Mask:
    """Joints that stand at no level and follow no other, shape (dof,)."""
    at_no_level = [levels is None or k != levels.joint for k in range(cell.robot.dof)]
    return np.asarray(cell.robot.free & at_no_level)


def listed(cell: Cell, table: Poses, choice: Choice) -> Visits:
    """The poses of a table, each with last moves by chance and at every moment, where these count.

    Last moves that the table tells are kept.
    """
    move = last_move(cell, table)
    sides = _TRIED_SIDES if choice.sided.any() and move is None else 1
    row = np.repeat(np.arange(len(table)), sides * max(1, len(choice.times)))
    even = np.random.default_rng(0).random((len(row), choice.dimensions))
    found = choice.visits(cell, table.q[row], even, 0)
    return found if move is None or not choice.sided.any() else replace(found, move=move[row])


def chunked(visits: Visits) -> Iterator[Visits]:
    """Candidates in chunks."""
    for start in range(0, len(visits), CHUNK):
        yield visits.take(slice(start, start + CHUNK))


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates that may be measured.

    visits : Visits, n of them
    packed : ndarray, shape (n, p (p + 1) / 2), information of each
    level : ndarray of int, shape (n,), of each its level or moment, zero without either
    visible : ndarray of bool, shape (n, C), readings that can be had at each
    drawn : int, candidates before the constraints
    removed_at : dict, constraint -> ndarray of int, candidates that it removed at each level, each
        counted where it fell first
    """

    visits: Visits
    packed: Array
    level: IntArray
    visible: Mask
    drawn: int
    removed_at: dict[str, IntArray]

    def __len__(self) -> int:
        return len(self.visits)

    @property
    def q(self) -> Array:
        """Joint values, shape (n, dof), rad or m."""
        return self.visits.q

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
        return Pool(self.visits.take(kept), *own, self.drawn, self.removed_at)

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
        joined([part.visits for part in parts]),
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
    visits: Visits,
) -> Pool:
    """Remove the candidates that may not be measured, and linearise the others."""
    cell, total = regressor.cell, len(visits)
    count, level = _levels_of(levels, visits)
    removed = {}
    if (level < 0).any():
        removed["levels"] = np.bincount([0] * int((level < 0).sum()), minlength=count)
        visits, level = visits.take(level >= 0), level[level >= 0]
    for constraint in constraints:
        if not len(visits):
            break
        kept = allowed(constraint, cell, visits)
        removed[constraint.name] = np.bincount(level[~kept], minlength=count)
        if not kept.all():
            visits, level = visits.take(kept), level[kept]
    seen = np.ones((0, len(cell.channels)), bool)
    seen = visible(scene_of(cell, visits.q)) if len(visits) else seen
    read = seen.any(axis=1)
    if not read.all():
        removed[OUT_OF_SIGHT] = np.bincount(level[~read], minlength=count)
        visits, level, seen = visits.take(read), level[read], seen[read]
    if not len(visits):
        empty = np.zeros((0, packed_size(regressor.T.shape[1])))
        return Pool(visits, empty, level, seen, total, removed)
    packed = pack(regressor.information(visits, None if seen.all() else seen))
    return Pool(visits, packed, level, seen, total, removed)


def _levels_of(levels: AngleLevels | None, visits: Visits) -> tuple[int, IntArray]:
    """How many levels, or moments, there are, and that of each candidate; -1 at none of them."""
    if levels is not None:
        return len(levels.values), levels.of(visits.q)
    if visits.moment is None:
        return 1, np.zeros(len(visits), dtype=int)
    return int(visits.moment.max(initial=0)) + 1, visits.moment


def allowed(constraint: Constraint, cell: Cell, visits: Visits) -> Mask:
    """Whether a constraint allows visits, (n,): what the arm may meet also where a last move begins."""
    found = constraint.allows(scene_of(cell, visits.q))
    if visits.move is None or not isinstance(constraint, Clearance):
        return found
    return np.asarray(found & constraint.allows(scene_of(cell, visits.q - visits.move)))


def pool_of(
    regressor: Regressor,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    chunks: Iterable[Visits],
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
    chunks: Iterable[Visits],
) -> tuple[Visits, Mask]:
    """Feasible candidates of every level, m of them, and their visible markers, shape (m, M).

    What the cell is like, of as many chunks as it takes. Raises CalibError where a
    level has none.
    """
    levels = request.levels
    count = 1 if levels is None else len(levels.values)
    found: list[Pool] = []
    per_level = np.zeros(count, dtype=int)
    for visits in chunks:
        found.append(judge(regressor, constraints, levels, visits))
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
    return pool.visits, pool.visible
