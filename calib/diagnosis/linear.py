"""The model and all suspects to first order, about one fit.

What is missing in a model moves points by millimetres at most, and squares of that do not show. So a
selection linearises once, and compares sets of effects by linear fits; what it ends with is fitted in
full (:meth:`calib.diagnosis.stage.Stage.exact`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray, in_parts
from calib.effects.protocol import Effect
from calib.effects.tuned import Tuned
from calib.identification.scan import times
from calib.model import Model
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class LinearModel(Model):
    """A model whose readings at some poses are taken to first order; elsewhere it is the model itself.

    at : Poses, where; read : ndarray of int, shape (m, c), channels that are read: others stay as they
        are
    readings_at_zero : ndarray, shape (m, C, r), with all values at zero, to first order
    columns : ndarray, shape (m, c, r, P), derivatives by everything; known : dict, id of an effect ->
        its columns; carried : dict, (kind, where) of an effect with a tuning -> those of its carrier
    """

    at: Poses
    read: IntArray
    readings_at_zero: Array
    columns: Array
    known: dict[int, IntArray]
    carried: dict[tuple[str, str], IntArray]

    def with_effects(self, effects: tuple[Effect, ...]) -> Model:
        """The same robot under other effects; the model itself where one was not linearised."""
        for effect in effects:
            if id(effect) not in self.known and (effect.kind, effect.where) not in self.carried:
                return self.exact.with_effects(effects)
        return super().with_effects(effects)

    @property
    def exact(self) -> Model:
        """The model itself."""
        return Model(**_described(self))

    def predict(self, values: Array, poses: Poses) -> Array:
        if poses is not self.at or values.ndim > 1:
            return super().predict(values, poses)
        return np.asarray(self.jacobian(values, poses)[0])

    def _jacobian(self, values: Array, poses: Poses) -> tuple[Array, Array]:
        if poses is not self.at or values.ndim > 1:
            return super()._jacobian(values, poses)
        J = self._last.get("own")  # the same array each time
        if J is None:
            by = np.concatenate([self.of(effect) for effect in self.effects], axis=-1)
            J = np.zeros((*self.readings_at_zero.shape, by.shape[-1]))
            J[_rows_of(self.read)] = by
            self._last["own"] = J
        moving = values.copy()
        moving[self.tunings] = 0.0
        return self.readings_at_zero + J @ moving, J

    def of(self, effect: Effect) -> Array:
        """Derivatives of what is read by an effect's parameters, (m, c, r, k), by its tuning none."""
        if not isinstance(effect, Tuned):
            return self.columns[..., self.known[id(effect)]]
        carrier = self.columns[..., self.carried[effect.kind, effect.where]]
        functions = effect.functions(self.at, np.array(effect.tuning))
        rows = times(carrier.reshape(len(functions), -1, carrier.shape[-1]), functions)
        return np.pad(rows.reshape((*carrier.shape[:-1], -1)), [(0, 0)] * 3 + [(1, 0)])


def linearised(
    model: Model,
    values: Array,
    poses: Poses,
    suspects: Sequence[Effect],
    read: IntArray | None = None,
) -> LinearModel:
    """A model to first order about some values, with suspects that it may be given.

    values : ndarray, shape (p,); read : ndarray of int, shape (m, c), channels that are read, all by
        default; suspects : those that are not in the model stand at nothing, and of
        those with a tuning the carrier, which has them at any
    """
    exact = model.exact if isinstance(model, LinearModel) else model
    tuned = [e for e in (*exact.effects, *suspects) if isinstance(e, Tuned)]
    carriers = {(e.kind, e.where): e.carrier for e in tuned}
    fixed = [e for e in suspects if not isinstance(e, Tuned)]
    whole, everything = exact.extended(values, [*fixed, *carriers.values()])
    m, shape = len(poses), (len(whole.readout.channels), whole.readout.channels.width)
    if read is None:
        read = np.tile(np.arange(shape[0]), (m, 1))
    readings, J = np.empty((m, *shape)), np.empty((*read.shape, shape[1], len(everything)))
    for own in in_parts(m, math.prod((*shape, len(everything)))):
        readings[own], by = whole.jacobian(everything, poses.take(own))
        J[own] = by[_rows_of(read[own])]
    known = {id(effect): np.arange(part.start, part.stop) for effect, part in whole.parts}
    carried = {key: known[id(carrier)] for key, carrier in carriers.items()}
    moving = everything.copy()
    moving[whole.tunings] = 0.0
    readings[_rows_of(read)] -= J @ moving
    return LinearModel(
        **_described(exact),
        at=poses,
        read=read,
        readings_at_zero=readings,
        columns=J,
        known=known,
        carried=carried,
    )


def _rows_of(read: IntArray) -> tuple[IntArray, IntArray]:
    """The index of channels (m, c) that are read in an array (m, C, ..)."""
    return np.arange(len(read))[:, None], read


def _described(model: Model) -> dict[str, Any]:
    """What makes a model, by name."""
    return {own.name: getattr(model, own.name) for own in fields(Model) if own.init}
