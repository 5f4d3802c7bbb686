"""Candidate poses: drawn over the joint box or read from a file, judged by the cell's constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

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

CHUNK = 2048
"""Configurations handled at once: a power of two keeps Sobol points balanced, and it fits the cache."""
OUT_OF_SIGHT = "out_of_sight"
"""What removes a configuration at which no instrument reads anything."""
MOST_PROBED = 65_536
"""Candidates among which those are looked for by which a cell is known."""
PROBE = 2000
"""Feasible configurations that are enough for that."""
_PER_LEVEL = 20
_LARGEST = 8e9  # bytes of information blocks
_STEP = 1e-2  # degrees or millimetres
_WORKERS = 2


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
class Feasible:
    """Candidates that may be measured.

    q : ndarray, shape (n, dof), rad or m; level : ndarray of int, shape (n,), zero without levels
    seen : ndarray of bool, shape (n, C), readings that can be had at each
    drawn : int, candidates before the constraints; removed : dict, what removed how many of them, each
        counted where it fell first
    """

    q: Array
    level: IntArray
    seen: Mask
    drawn: int
    removed: dict[str, int]

    @classmethod
    def of(
        cls,
        cell: Cell,
        constraints: tuple[Constraint, ...],
        levels: AngleLevels | None,
        q: Array,
    ) -> Feasible:
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
    def together(cls, parts: Sequence[Feasible]) -> Feasible:
        """Several as one."""
        names = dict.fromkeys(name for part in parts for name in part.removed)
        return cls(
            np.concatenate([part.q for part in parts]),
            np.concatenate([part.level for part in parts]),
            np.concatenate([part.seen for part in parts]),
            sum(part.drawn for part in parts),
            {name: sum(part.removed.get(name, 0) for part in parts) for name in names},
        )

    def too_few(self, where: str = "", found: int = 0, needed: int = 1) -> str:
        """Why nothing, or too little, is left to choose from."""
        what = f"no feasible candidate{where}"
        if found:
            only = f"only {found} feasible candidate{'s' if found > 1 else ''}"
            what = f"{only}{where}, and {needed} are needed"
        causes = sorted(((n, name) for name, n in self.removed.items() if n), reverse=True)
        if not causes:
            return f"{what}; draw more, or allow repeats"
        most, name = causes[0]
        if most >= self.drawn and name.startswith("obstacle"):
            return f"{what}: the arm meets {name} wherever it stands; move it, or make it smaller"
        said = ", ".join(f"{name} removed {n}" for n, name in causes)
        return f"{what}: of {self.drawn}, {said}; relax what removed most"


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates with their information.

    feasible : Feasible, n of them; packed : ndarray, shape (n, p (p + 1) / 2), information of each
    """

    feasible: Feasible
    packed: Array

    def __len__(self) -> int:
        return len(self.q)

    @property
    def q(self) -> Array:
        """Shape (n, dof), rad or m."""
        return self.feasible.q

    @property
    def level(self) -> IntArray:
        """Level of each, shape (n,), zero without levels."""
        return self.feasible.level

    def without(self, q: Array) -> Pool:
        """The candidates that are none of these configurations (m, dof)."""
        known, every = {tuple(row) for row in np.round(q, 9)}, self.feasible
        fresh = np.array([tuple(row) not in known for row in np.round(self.q, 9)], dtype=bool)
        removed = {**every.removed, "already measured": int((~fresh).sum())}
        left = Feasible(every.q[fresh], every.level[fresh], every.seen[fresh], every.drawn, removed)
        return Pool(left, self.packed[fresh])

    def plus(self, regressor: Regressor, levels: AngleLevels | None, q: Array) -> Pool:
        """The candidates and further configurations (m, dof), which keep the constraints."""
        more = Feasible.of(regressor.cell, (), levels, q)
        both = np.concatenate([self.packed, _packed(regressor, more)])
        return Pool(Feasible.together([self.feasible, more]), both)


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
    size = packed_size(len(regressor.T))
    if 8.0 * count * size > _LARGEST:
        raise CalibError(
            f"{count} candidates for {len(regressor.T)} parameters need "
            f"{8e-9 * count * size:.0f} GB; ask for at most {int(_LARGEST / 8.0 / size)}"
        )

    def judged(q: Array) -> tuple[Feasible, Array]:
        part = Feasible.of(regressor.cell, constraints, levels, q)
        return part, _packed(regressor, part)

    packed, parts, start = np.empty((count, size)), [], 0
    with ThreadPoolExecutor(_WORKERS) as executor:
        for part, rows in executor.map(judged, chunks):
            packed[start : start + len(rows)] = rows
            parts.append(part)
            start += len(rows)
    return Pool(Feasible.together(parts), packed[:start])


def _packed(regressor: Regressor, part: Feasible) -> Array:
    if not len(part.q):
        return np.zeros((0, packed_size(len(regressor.T))))
    return pack(regressor.information(part.q, None if part.seen.all() else part.seen))


def probe_of(
    cell: Cell,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    chunks: Iterable[Array],
) -> Feasible:
    """What the cell is like: feasible candidates of every level, of as many chunks as it takes.

    Raises CalibError where a level has none.
    """
    found: list[Feasible] = []
    each = np.zeros(1 if levels is None else len(levels.values), dtype=int)
    every = levels is not None and levels.chosen  # a level that is to be chosen may have none
    for q in chunks:
        found.append(Feasible.of(cell, constraints, levels, q))
        each += np.bincount(found[-1].level, minlength=len(each))
        if each.sum() >= PROBE and (not every or each.min() >= _PER_LEVEL):
            break
    probe = Feasible.together(found)
    if not each.all() if every else not each.any():
        where = at_level(cell, levels, int(each.argmin())) if every else ""
        raise CalibError(probe.too_few(where if len(each) > 1 else ""))
    return probe
