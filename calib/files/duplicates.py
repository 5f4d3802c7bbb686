"""What a table of readings holds twice: the payload's weight, or readings copied to the last digit.

An instrument repeats each digit only by chance. Where the digits are finer than its noise, that chance
is known, and what is far below it was not measured anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arm.statics import wrench_with_load
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import InputError
from calib.files.csv_table import CsvTable
from calib.files.readings import reading_columns
from calib.instruments import Tracker
from calib.poses import Measurements, Poses, hung

_SAME = 0.01  # of the weight


def refuse_payload_and_wrench(cell: Cell, path: Path, poses: Poses) -> None:
    """Refuse readings that bear the cell's payload as their wrench. Raises InputError."""
    loaded = poses.take(poses.wrench.any(axis=1))
    if not cell.payload.mass or cell.payload.frame != cell.robot.loaded or not len(loaded):
        return
    free = replace(loaded, wrench=np.zeros_like(loaded.wrench))
    carried = hung(free, cell.payload.mass, cell.payload.com)
    weight = wrench_with_load(cell.robot, cell.gravity, carried)
    moment = loaded.wrench[:, 3:]
    if _alike(loaded.wrench[:, :3], weight[:, :3]) and (
        not moment.any() or _alike(moment, weight[:, 3:])
    ):
        raise InputError(
            path,
            "columns of the wrench",
            f"hold the weight of the cell's [payload], {cell.payload.mass:g} kg, once more",
            "a load counts once: take [payload] out of the cell, or these columns out of the table",
        )


def _alike(found: Array, expected: Array) -> bool:
    off = np.linalg.norm(found - expected, axis=1)
    return bool((off <= _SAME * np.linalg.norm(expected, axis=1)).all())


_QUIETER = 10.0  # times less noise than stated: cells state limits, and repeats share errors
_CHANCE = 1e-6  # that an honest table is called copied
_SHOWN = 4


@dataclass(frozen=True, eq=False)
class _Same:
    """Readings that equal an earlier one.

    later, earlier : ndarray of int, poses; joints : ndarray of bool, whether their joints are equal too
    """

    later: IntArray
    earlier: IntArray
    joints: Mask

    def named(self, names: tuple[str, ...], chosen: Mask) -> str:
        """Those chosen, in pairs."""
        pairs = [
            f"{names[i]} and {names[j]}"
            for i, j in zip(self.earlier[chosen], self.later[chosen], strict=True)
        ]
        more = f" .. ({len(pairs)} in all)" if pairs[_SHOWN:] else ""
        return ", ".join(pairs[:_SHOWN]) + more


def without_copies(table: CsvTable, cell: Cell, data: Measurements, path: Path) -> Measurements:
    """The measurements without poses that are copies of others, with a warning of each kind.

    A pose whose joints, load and points are all those of an earlier pose is left out: it tells nothing
    new, and would make the arm look as if it never scattered. One whose points alone are those of
    another stays, as nobody knows which of both is right, and is named.
    """
    instrument, found = cell.instruments[0], _same(data)
    if len(cell.instruments) != 1 or not isinstance(instrument, Tracker) or not len(found.later):
        return data
    by_chance = _by_chance(table, instrument, data)[found.later]
    names, warnings = data.poses.names, []
    stuck = ~found.joints & (by_chance * len(data) ** 2 < _CHANCE)
    if stuck.any():
        warnings.append(
            f"{path}: the points of {found.named(names, stuck)} are equal to the last digit, but the "
            "joints are not: the instrument stuck, or rows were copied; measure these poses again"
        )
    copied = found.joints & _too_many(data, found, by_chance)
    if copied.any():
        warnings.append(
            f"{path}: {found.named(names, copied)} are equal to the last digit: copies, and the "
            "second of each is left out; give only what was measured"
        )
        keep = np.ones(len(data), dtype=bool)
        keep[found.later[copied]] = False
        data = data.take(keep)
    return replace(data, warnings=(*data.warnings, *warnings))


def _same(data: Measurements) -> _Same:
    """Every reading whose points are those of an earlier one, bit for bit."""
    poses = data.poses
    first: dict[tuple[int, bytes, bytes], int] = {}
    later, earlier, joints = [], [], []
    told = None if poses.approach_derived else poses.approach
    for i in range(len(data)):
        points = (int(poses.station[i]), data.seen[i].tobytes(), data.readings[i].tobytes())
        if not data.seen[i].any():
            continue
        j = first.setdefault(points, i)
        if j != i:
            fields = [poses.q, poses.wrench, *([] if told is None else [told])]
            later.append(i)
            earlier.append(j)
            joints.append(all(np.array_equal(own[i], own[j]) for own in fields))
    return _Same(np.array(later, dtype=int), np.array(earlier, dtype=int), np.array(joints, bool))


def _by_chance(table: CsvTable, instrument: Tracker, data: Measurements) -> Array:
    """Probability, shape (m,), that a reading repeats every digit of another at the same place.

    Of one coordinate with the noise s, shown in steps of d, that is d / (2 sqrt(pi) s), 1 at most.
    """
    columns = reading_columns(table.path, instrument, table.columns)
    steps = []
    for name, scale in columns:  # zeros at the end of a number tell nothing
        texts = (text.lower().partition("e")[0] for text in table.text(name))
        decimals = max(len(text.partition(".")[2].rstrip("0")) for text in texts)
        steps.append(10.0**-decimals * scale)
    stated = np.where(np.isfinite(data.sigma), data.sigma, instrument.noise.along)
    share = np.array(steps) / (2.0 * np.sqrt(np.pi) * stated[..., None] / _QUIETER)
    each = np.where(data.seen[..., None], np.minimum(share, 1.0), 1.0)
    return np.asarray(each.prod(axis=(1, 2)))


def _too_many(data: Measurements, found: _Same, by_chance: Array) -> bool:
    """Whether more readings at equal joints are equal than an instrument with noise would repeat."""
    from scipy.special import betainc

    _, counts = np.unique(data.poses.repeated, return_counts=True)
    again = int((counts - 1).sum())
    equal = int(found.joints.sum())
    if not equal:
        return False
    chance = float(by_chance[found.joints].max())
    # So many or more of ``again`` by chance: the tail of a binomial distribution.
    return bool(betainc(equal, max(again, equal) - equal + 1, chance) < _CHANCE)
