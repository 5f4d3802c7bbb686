"""Instruments and what they read, as lines around and on the arm: whole millimetres, base frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.base import Base
from calib.errors import CalibError
from calib.identification.start import initial_values
from calib.instruments import (
    Camera,
    Distance,
    Instrument,
)
from calib.model.build import build, parse_effect
from calib.poses import Measurements, Poses
from studies.report.surroundings import hull

Kind: TypeAlias = Literal[
    "camera", "board", "frame", "socket", "sphere", "touched", "wire", "instrument"
]
_DROPPED = ("camera", "socket", "sphere", "wire", "instrument")
_NEAR = 3.0  # arm lengths; what stands farther from the middle is not drawn


@dataclass(frozen=True, eq=False)
class Fixture:
    """An instrument, or what it reads. Points are (m, k, 3), or (1, k, 3) where they stand still, mm.

    lines : tuple of ndarray of int; dots : ndarray of int, n points
    label : ndarray of int, one point, where words stand; radius : int, mm, of the dots, or 0
    words : what is written there: its name, or of what stands close together one for all
    """

    kind: Kind
    name: str
    lines: tuple[IntArray, ...]
    dots: IntArray
    label: IntArray
    radius: int = 0
    words: str = ""

    @property
    def dropped(self) -> bool:
        """Whether its place on the floor is shown."""
        return self.kind in _DROPPED

    @property
    def points(self) -> list[IntArray]:
        """All of them: lines, dots, the place of the name."""
        return [*self.lines, self.dots, self.label]


@dataclass(frozen=True, eq=False)
class Placed:
    """Where instruments stand and markers sit, as given or as the readings tell.

    places : dict, name of an instrument, or of one of its sites -> place (u,)
    markers : ndarray, shape (M, 3), m, tip frame
    """

    places: Mapping[str, Array] = field(default_factory=dict)
    markers: Array = field(default_factory=lambda: np.zeros((0, 3)))


def placed(cell: Cell, plan: Poses | Measurements) -> Placed:
    """From measured readings as an identification starts; else what the cell says, and no more."""
    known = {name: i.guess_at(name) for i in cell.instruments if _given(i) for name in i.names}
    placing = tuple(e for e in cell.effects if parse_effect(e)[0] in ("base", "tool"))
    if not isinstance(plan, Measurements) or not placing:
        return Placed(known, cell.markers)
    try:
        model = build(replace(cell, effects=placing), plan.poses).model
        values = initial_values(model, plan)
    except CalibError:  # too little to tell
        return Placed(known, cell.markers)
    found = {
        (effect.where if effect.of.sites else effect.of.name): values[part]
        for effect, part in zip(model.effects, model.slices, strict=True)
        if isinstance(effect, Base) and effect.station in (None, 0)
    }
    return Placed({**known, **found}, model.marker_positions(values))


def _given(instrument: Instrument) -> bool:
    if isinstance(instrument, Camera):
        return instrument.standing is not None
    if isinstance(instrument, Distance):
        return instrument.anchor is not None
    return instrument.touches and not instrument.unforeseen


def within(
    drawn: Sequence[Fixture], frame: IntArray, length: float
) -> tuple[tuple[Fixture, ...], dict[str, float], IntArray]:
    """Those near an arm of some length [mm], how far off [m] the others stand, and the frame of all."""
    middle = (frame.min(axis=0) + frame.max(axis=0)) / 2.0
    kept: list[Fixture] = []
    beyond: dict[str, float] = {}
    for own in drawn:
        away = np.linalg.norm(own.label - middle, axis=-1)
        if own.label.shape[0] == 1 and float(away.max()) > _NEAR * length:
            beyond[own.name] = float(np.linalg.norm(own.label[0, 0])) / 1e3
        else:
            kept.append(own)
    points = [p.reshape(-1, 3) for own in kept for p in own.points]
    points += [own.label.reshape(-1, 3) * np.array([1, 1, 0]) for own in kept if own.dropped]
    return tuple(kept), beyond, hull(np.concatenate([frame, *points])) if points else frame
