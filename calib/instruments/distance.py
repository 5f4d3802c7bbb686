"""A ballbar, a draw-wire or an interferometer: the distance from an anchor, plus an offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from calib.arrays import Array, Mask
from calib.instruments.keys_table import CellParts, KeysTable
from calib.instruments.protocol import POINT, ZERO, Linear, Nominal, ReadingColumn, Start, Unknown
from calib.instruments.touching import Even, around, best, contacts, mirrored
from calib.keys import Flag, Point, PositiveMetres, key


@dataclass(frozen=True, eq=False)
class Distance(Even):
    """``|p - c| + offset``; anchor c and offset, where there is one, are its place, in base axes.

    standing : its anchor, shape (3,), m, base frame
    known : whether that is where it stands, and no guess
    """

    known: bool = False
    offset: bool = False
    kind: ClassVar[str] = "distance"
    rows: ClassVar[int] = 1
    given_by: ClassVar[str] = "anchor_mm"
    loose: ClassVar[slice | None] = ZERO
    columns: ClassVar[tuple[ReadingColumn, ...]] = (ReadingColumn("d", "length"),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        offset = (Unknown("offset", "mm", 1e-3, 1e-2),) if self.offset else ()
        return (*(() if self.known else POINT), *offset)

    @property
    def anchored(self) -> bool:
        return self.known

    def guess_at(self, name: str) -> Array:
        return np.zeros(len(self.unknowns)) if self.known else super().guess_at(name)

    @property
    def position(self) -> Array | None:
        return self.standing

    def linearise(self, place: Array, points: Array) -> Linear:
        anchor = place[..., :3] if not self.known or self.standing is None else self.standing
        shifts = place[..., 0 if self.known else len(POINT) :]  # added to the distance, all alike
        away = points - anchor[..., None, None, :]
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        along = (away / distance)[..., None, :]
        by_shifts = np.ones((*distance.shape, shifts.shape[-1]))
        by_place = np.concatenate([*([] if self.known else [-along]), by_shifts], axis=-1)
        rows = distance + shifts.sum(axis=-1)[..., None, None, None]
        return Linear(rows, along, by_place)

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """``|p|^2 - d^2 = 2 p c - 2 d o - (|c|^2 - o^2)``, its mirror, and from all around."""
        _, _, p = contacts(seen, arm)
        d = rows[seen][:, 0]
        shift = -2.0 * d[:, None] if self.offset else np.zeros((len(d), 0))
        A = np.column_stack([2.0 * p, shift, -np.ones(len(p))])
        linear = np.linalg.lstsq(A, (p**2).sum(axis=1) - d**2, rcond=1e-6)[0][:3]
        anchors = [linear, mirrored(linear, p), *around(p, float(np.median(np.abs(d))))]
        if self.standing is not None:
            anchors = [self.standing] if self.known else [self.standing, *anchors]
        starts = []
        for anchor in anchors:
            offset = np.median(d - np.linalg.norm(p - anchor, axis=-1))
            starts.append([*([] if self.known else anchor), *([offset] if self.offset else [])])
        return best(self, rows, seen, arm, np.array(starts, dtype=float))


class DistanceTable(KeysTable):
    """A ballbar or wire: its keys in a cell."""

    makes = Distance
    kind: Literal["distance"]
    sigma: Annotated[PositiveMetres, key("sigma_mm")]
    """one standard deviation of a length"""
    standing: Annotated[Point | None, key("anchor_mm")] = None
    """distance: where it is measured from; found if absent"""
    offset: Flag = False
    """distance: whether a constant is added to it"""

    def instrument(self, name: str, cell: CellParts) -> Distance:
        known = self.standing is not None and not cell.placed
        return Distance(name=name, markers=cell.read_from(self.on), known=known, **self.fields)
