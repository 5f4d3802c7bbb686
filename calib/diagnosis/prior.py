"""Normal priors that keep candidates near zero.

That of a single parameter is as wide as such errors are seldom larger on this arm. Curves, and causes
of several parameters, have one size each, which follows the data. Errors that the cell states as common
to all readings are unknowns about zero, as likely as it says: what lies within them is no cause; what
is far larger still is, for the statement then costs more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.diagnosis.curves import Curve
from calib.effects.context import Context
from calib.effects.protocol import Effect, Parameter
from calib.effects.readings import ReadingEffect
from calib.effects.tuned import Tuned
from calib.instruments import Instrument, Tracker
from calib.instruments.common_errors import CommonError
from calib.model import Model
from calib.poses import Measurements, Poses

Amplitudes: TypeAlias = Mapping[Effect, float]
"""Size a priori of the parameters of a curve, or of a cause of several, in plausible sizes."""


def curves_in(model: Model) -> Iterator[tuple[Curve, slice]]:
    """The curves of a model, and where their coefficients stand."""
    yield from ((effect, part) for effect, part in model.parts if isinstance(effect, Curve))


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters of one common size.

    part : slice, where they stand; inverse : ndarray, shape (k, k), that makes them independent and of
        unit variance where the amplitude is one; largest : float, amplitude that is seldom met
    """

    effect: Effect
    part: slice
    inverse: Array
    largest: float


def blocks_in(model: Model) -> Iterator[Block]:
    """Curves, and causes by name of several parameters."""
    for effect, part in model.parts:
        sizes = np.array([p.size for p in effect.parameters])
        if isinstance(effect, Curve):
            root = np.linalg.cholesky(effect.spread) * sizes[0]
            yield Block(effect, part, np.linalg.inv(root), np.inf)
        elif effect.allowance is not None and len(sizes) > 1 and not isinstance(effect, Tuned):
            limits = effect.allowance * np.array([p.limit for p in effect.parameters])
            yield Block(effect, part, np.diag(1.0 / sizes), float((limits / sizes).max()))


def prior_rows(model: Model, amplitudes: Amplitudes) -> Array:
    """Rows of unit variance, shape (h, p): of causes one over their limits, of blocks by amplitude.

    Where no amplitude is known it is one.
    """
    limits = np.full(len(model.parameters), np.inf)
    for effect, part in model.parts:
        if effect.allowance is not None:
            limits[part] = effect.allowance * np.array([p.limit for p in effect.parameters])
    limits[model.tunings] = np.inf
    rows = []
    for block in blocks_in(model):
        own = np.zeros((len(block.inverse), len(model.parameters)))
        own[:, block.part] = block.inverse / amplitudes.get(block.effect, 1.0)
        limits[block.part] = np.inf
        rows.append(own)
    return np.concatenate([np.diag(1.0 / limits)[np.isfinite(limits)], *rows])


@dataclass(frozen=True, eq=False)
class CommonErrorEffect(ReadingEffect):
    """One common error of one tracker, in standard uncertainties.

    by : beams (..., 3), m -> displacements (..., 3, b), m, by one unit of each of its components
    origins : ndarray, shape (S, 3), m, where its beams begin, in the axes of each station
    """

    error: CommonError
    by: Callable[[Array], Array]
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
        return self.by(beams) * self.error.std


def common_errors(model: Model, values: Array, data: Measurements) -> Iterator[CommonErrorEffect]:
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
            if (by := error.kind.columns) is not None:
                yield CommonErrorEffect(instrument.name, error, by, origins)
