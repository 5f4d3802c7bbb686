"""Errors that the cell states as common to all readings: unknowns about zero, as likely as it says.

What lies within them is no cause; what is far larger still is, for the statement then costs more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import Context, Parameter, ReadingEffect
from calib.instruments import Instrument, Tracker
from calib.instruments.common_errors import CommonError
from calib.model import Model
from calib.poses import Measurements, Poses


@dataclass(frozen=True, eq=False)
class Stated(ReadingEffect):
    """One common error of one tracker, in standard uncertainties.

    origins : ndarray, shape (S, 3), m, where its beams begin, in the axes of each station
    """

    error: CommonError
    origins: Array
    kind: ClassVar[str] = "common_error"

    def changes(self, instrument: Instrument) -> bool:
        return instrument.name == self.where

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        each = range(self._columns(np.ones((1, 3))).shape[-1])
        names = (f"{self.error.key}.{k}" for k in each)
        return tuple(Parameter(self.kind, self.where, name, "std", 1.0, 1.0) for name in names)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        del context
        return ()  # only a cell states them

    @property
    def believed(self) -> Array:
        return np.ones(len(self.parameters))

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        columns = self._columns(points - self.origins[poses.station][:, None])
        moved = (columns @ values[..., None, None, :, None])[..., 0]
        # A beam is longer than what it errs by: the error of a neighbouring point is the same.
        return points + moved, np.eye(3)[None, None], columns

    def _columns(self, beams: Array) -> Array:
        """Displacements (..., 3, b), m, of points by one standard uncertainty of each component."""
        by = self.error.kind.columns
        if by is None:
            raise NotImplementedError(f"{self.error.key} moves no reading")
        return by(beams) * self.error.std


def stated(model: Model, values: Array, data: Measurements) -> Iterator[Stated]:
    """Those of a model's trackers; a direction of gravity is none, for it moves no reading.

    values : ndarray, shape (p,), SI, by which the instruments stand
    """
    for instrument, part in model.readout.channels.blocks:
        if not (isinstance(instrument, Tracker) and instrument.common):
            continue
        readings = data.readings[:, part, : instrument.rows]
        starts = readings - model.readout.beams(instrument, values, data.poses, readings)
        origins = np.zeros((len(data.poses.stations), 3))
        origins[data.poses.station] = starts[:, 0]
        for error in instrument.common:
            if error.kind.columns is not None:
                yield Stated(instrument.name, error, origins)
