"""What a table of readings holds twice: the payload's weight, or readings copied to the last digit.

An instrument repeats each digit only by chance. Where the digits are finer than its noise, that chance
is known, and what is far below it was not measured anew.
"""

from __future__ import annotations

from dataclasses import replace
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
_QUIETER = 10.0  # times less noise than stated: cells state limits, and repeats share errors
_CHANCE = 1e-6  # that an honest table is called copied
_SHOWN = 4


def refuse_payload_and_wrench(cell: Cell, path: Path, poses: Poses) -> None:
    """Refuse readings that bear the cell's payload as their wrench. Raises InputError."""
    loaded, payload = poses.take(poses.wrench.any(axis=1)), cell.payload
    if not payload.mass or payload.frame != cell.robot.loaded or not len(loaded):
        return
    free = hung(replace(loaded, wrench=np.zeros_like(loaded.wrench)), payload.mass, payload.com)
    weight = wrench_with_load(cell.robot, cell.gravity, free)
    off, size = ((a[:, :3], a[:, 3:]) for a in (loaded.wrench - weight, weight))
    force, moment = (
        bool((np.linalg.norm(a, axis=1) <= _SAME * np.linalg.norm(b, axis=1)).all())
        for a, b in zip(off, size, strict=True)
    )
    if force and (moment or not loaded.wrench[:, 3:].any()):
        what = f"hold the weight of the cell's [payload], {payload.mass:g} kg, once more"
        remedy = "take [payload] out of the cell, or these columns out of the table"
        where = "columns of the wrench"
        raise InputError(path, where, what, f"a load counts once: {remedy}")


def without_copies(table: CsvTable, cell: Cell, data: Measurements, path: Path) -> Measurements:
    """The measurements without poses that are copies of others, with a warning of each kind.

    A pose whose joints, load and points are all those of an earlier pose is left out: it tells nothing
    new, and would make the arm look as if it never scattered. One whose points alone are those of
    another stays, as nobody knows which of both is right, and is named.
    """
    instrument = cell.instruments[0]
    if len(cell.instruments) != 1 or not isinstance(instrument, Tracker):
        return data
    pairs, alike = _same(data)
    if not len(pairs):
        return data
    chance = _by_chance(table, instrument, data)[pairs[:, 1]]
    unlikely = chance * len(data) ** 2 < _CHANCE
    stuck, copied = pairs[~alike & unlikely], pairs[alike & unlikely]
    warnings = [*data.warnings]
    if len(stuck):
        warnings.append(
            f"{path}: the points of {_named(data, stuck)} are equal to the last digit, but the "
            "joints are not: the instrument stuck, or rows were copied; measure these poses again"
        )
    if len(copied):
        warnings.append(
            f"{path}: {_named(data, copied)} are equal to the last digit: copies, and the "
            "second of each is left out; give only what was measured"
        )
    kept = ~np.isin(np.arange(len(data)), copied[:, 1])
    return replace(data.take(kept), warnings=tuple(warnings))


def _named(data: Measurements, pairs: IntArray) -> str:
    names = [" and ".join(data.poses.names[i] for i in pair) for pair in pairs.tolist()]
    more = f" .. ({len(names)} in all)" if names[_SHOWN:] else ""
    return ", ".join(names[:_SHOWN]) + more


def _same(data: Measurements) -> tuple[IntArray, Mask]:
    """Readings whose points are those of an earlier one, bit for bit.

    Returns the earlier and the later pose, shape (k, 2), and whether their joints are equal too, (k,).
    """
    poses, first = data.poses, dict[tuple[int, bytes, bytes], int]()
    stated = [] if poses.approach is None or poses.approach_derived else [poses.approach]
    pairs, alike = [], []
    for i in np.flatnonzero(data.seen.any(axis=1)).tolist():
        points = (int(poses.station[i]), data.seen[i].tobytes(), data.readings[i].tobytes())
        j = first.setdefault(points, i)
        if j != i:
            pairs.append((j, i))
            fields = (poses.q, poses.wrench, *stated)
            alike.append(all(np.array_equal(a[i], a[j]) for a in fields))
    return np.array(pairs, dtype=int).reshape(-1, 2), np.array(alike, dtype=bool)


def _by_chance(table: CsvTable, instrument: Tracker, data: Measurements) -> Array:
    """Probability, shape (m,), that a reading repeats every digit of another at the same place.

    Of one coordinate with the noise s, shown in steps of d, that is d / (2 sqrt(pi) s), 1 at most.
    """
    steps = []
    for name, scale in reading_columns(table.path, instrument, table.columns):
        texts = (text.lower().partition("e")[0].partition(".")[2] for text in table.text(name))
        decimals = max(len(text.rstrip("0")) for text in texts)  # zeros at the end say nothing
        steps.append(10.0**-decimals * scale)
    stated = np.where(np.isfinite(data.sigma), data.sigma, instrument.noise.along)
    share = np.array(steps) / (2.0 * np.sqrt(np.pi) * stated[..., None] / _QUIETER)
    each = np.where(data.seen[..., None], np.minimum(share, 1.0), 1.0)
    return np.asarray(each.prod(axis=(1, 2)))
