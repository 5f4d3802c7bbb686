"""Candidate poses: drawn over the joint box or read from a file, judged by the cell's constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import CalibError
from calib.sobol import Sobol
from doe.constraints import Constraint, scene_of, visible
from doe.information import Regressor
from doe.levels import AngleLevels, at_level
from doe.optimal.blocks import pack, packed_size
from doe.views import NUMBERS, looking, views_of

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
    sampler = Sobol(len(free) + (NUMBERS if views_of(cell) else 0), np.random.default_rng(seed))
    for start in range(0, count, CHUNK):
        turn = np.arange(start, min(start + CHUNK, count))
        q, points = np.tile(low, (len(turn), 1)), sampler.random(len(turn))
        q[:, free] += points[:, : len(free)] * (high - low)[free]
        q = cell.robot.tied(_levelled(rounded(cell, q), levels, turn))
        yield _looking_in_turn(cell, q, points[:, len(free) :], levels, turn)


def _looking_in_turn(
    cell: Cell, q: Array, even: Array, levels: AngleLevels | None, turn: IntArray
) -> Array:
    """Configurations (m, dof) for one camera's view after the other, and for all other instruments.

    even : ndarray, shape (m, 6), in [0, 1), how a board stands in a view; (m, 0) where there is none
    turn : ndarray of int, shape (m,), number of each
    """
    views = views_of(cell)
    if not views:
        return q
    seeing = {view.camera.name for view in views}
    others = int(any(i.name not in seeing for i in cell.instruments))
    count = 1 if levels is None else len(levels.values)
    wanted = (turn // count) % (len(views) + others)
    viewing = wanted < len(views)
    seen = looking(cell, q, np.where(viewing, wanted, -1), even, movable(cell, levels))
    q = np.where(viewing[:, None], rounded(cell, seen), q)
    return cell.robot.tied(_levelled(q, levels, turn))


def _levelled(q: Array, levels: AngleLevels | None, turn: IntArray) -> Array:
    """Configurations at one level after the other."""
    if levels is not None:
        q[:, levels.joint] = levels.values[turn % len(levels.values)]
    return q


def movable(cell: Cell, levels: AngleLevels | None) -> Mask:
    """Joints that stand at no level and follow no other, shape (dof,)."""
    at_no_level = [levels is None or k != levels.joint for k in range(cell.robot.dof)]
    return np.asarray(cell.robot.free & at_no_level)


def chunked(q: Array) -> Iterator[Array]:
    """Candidates in chunks."""
    return (q[start : start + CHUNK] for start in range(0, len(q), CHUNK))


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates that may be measured, with their information.

    q : ndarray, shape (n, dof), rad or m; level : ndarray of int, shape (n,), zero without levels
    seen : ndarray of bool, shape (n, C), readings that can be had at each
    drawn : int, candidates before the constraints; removed : dict, what removed how many of them, each
        counted where it fell first
    packed : ndarray, shape (n, p (p + 1) / 2), information of each, without columns until it is asked
    """

    q: Array
    level: IntArray
    seen: Mask
    drawn: int
    removed: dict[str, int]
    packed: Array

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def feasible(
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
        return cls(q, level, seen, drawn, removed, np.zeros((len(q), 0)))

    @classmethod
    def together(cls, parts: Sequence[Pool], packed: Array | None = None) -> Pool:
        """Several as one; packed : their information, where it stands together already."""
        names = dict.fromkeys(name for part in parts for name in part.removed)
        return cls(
            np.concatenate([part.q for part in parts]),
            np.concatenate([part.level for part in parts]),
            np.concatenate([part.seen for part in parts]),
            sum(part.drawn for part in parts),
            {name: sum(part.removed.get(name, 0) for part in parts) for name in names},
            np.concatenate([part.packed for part in parts]) if packed is None else packed,
        )

    def informed(self, regressor: Regressor) -> Pool:
        """The same with the information of each."""
        if not len(self):
            return replace(self, packed=np.zeros((0, packed_size(len(regressor.T)))))
        seen = None if self.seen.all() else self.seen
        return replace(self, packed=pack(regressor.information(self.q, seen)))

    def without(self, q: Array) -> Pool:
        """The candidates that are none of these configurations (m, dof)."""
        known = {tuple(row) for row in np.round(q, 9)}
        fresh = np.array([tuple(row) not in known for row in np.round(self.q, 9)], dtype=bool)
        removed = {**self.removed, "already measured": int((~fresh).sum())}
        q, level, seen = self.q[fresh], self.level[fresh], self.seen[fresh]
        return Pool(q, level, seen, self.drawn, removed, self.packed[fresh])

    def plus(self, regressor: Regressor, levels: AngleLevels | None, q: Array) -> Pool:
        """The candidates and further configurations (m, dof), which keep the constraints."""
        more = Pool.feasible(regressor.cell, (), levels, q).informed(regressor)
        return Pool.together([self, more])

    def too_few(self, where: str = "", count: int = 0, needed: int = 1) -> CalibError:
        """Why nothing, or too little, is left to choose from."""
        what = f"no feasible candidate{where}"
        if count:
            only = f"only {count} feasible candidate{'s' if count > 1 else ''}"
            what = f"{only}{where}, and {needed} are needed"
        causes = sorted(((n, name) for name, n in self.removed.items() if n), reverse=True)
        if not causes:
            return CalibError(f"{what}; draw more, or allow repeats")
        most, name = causes[0]
        if most >= self.drawn and name.startswith("obstacle"):
            return CalibError(
                f"{what}: the arm meets {name} wherever it stands; move it, or make it smaller"
            )
        said = ", ".join(f"{name} removed {n}" for n, name in causes)
        return CalibError(f"{what}: of {self.drawn}, {said}; relax what removed most")


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

    def judged(q: Array) -> Pool:
        return Pool.feasible(regressor.cell, constraints, levels, q).informed(regressor)

    packed, parts, start = np.empty((count, size)), [], 0
    with ThreadPoolExecutor(_WORKERS) as executor:
        for part in executor.map(judged, chunks):
            packed[start : start + len(part)] = part.packed
            parts.append(replace(part, packed=part.packed[:0]))
            start += len(part)
    return Pool.together(parts, packed[:start])


def probe_of(
    cell: Cell,
    constraints: tuple[Constraint, ...],
    levels: AngleLevels | None,
    chunks: Iterable[Array],
) -> Pool:
    """What the cell is like: feasible candidates of every level, of as many chunks as it takes.

    Raises CalibError where a level has none.
    """
    parts: list[Pool] = []
    each = np.zeros(1 if levels is None else len(levels.values), dtype=int)
    every = levels is not None and levels.chosen  # a level that is to be chosen may have none
    for q in chunks:
        parts.append(Pool.feasible(cell, constraints, levels, q))
        each += np.bincount(parts[-1].level, minlength=len(each))
        if each.sum() >= PROBE and (not every or each.min() >= _PER_LEVEL):
            break
    probe = Pool.together(parts)
    if not each.all() if every else not each.any():
        where = at_level(cell, levels, int(each.argmin())) if every and len(each) > 1 else ""
        raise probe.too_few(where)
    return probe
