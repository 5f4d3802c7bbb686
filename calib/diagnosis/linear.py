"""The model and all suspects to first order, about one fit.

What is missing in a model moves points by millimetres at most, and squares of that do not show. So a
contest linearises once, and compares sets of effects by linear fits; what it ends with is fitted in
full (:meth:`calib.diagnosis.stage.Stage.exact`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.effects.protocol import Effect
from calib.model import Model
from calib.poses import IntArray, Poses
from calib.se3 import Array


@dataclass(frozen=True, eq=False)
class LinearModel(Model):
    """A model whose readings at some poses are taken to first order; elsewhere it is the model itself.

    at : Poses, where; readings : ndarray, shape (m, M, 3), m, with all values at zero, to first order
    columns : ndarray, shape (m, M, 3, P), derivatives by everything; known : dict, id of an effect ->
        its columns
    """

    at: Poses
    readings_at_zero: Array
    columns: Array
    known: dict[int, IntArray]

    def with_effects(self, effects: tuple[Effect, ...]) -> Model:
        """The same robot under other effects; the model itself where one was not linearised."""
        exact = self.exact.with_effects(effects)
        if any(id(effect) not in self.known for effect in effects):
            return exact
        return self._of(exact)

    @property
    def exact(self) -> Model:
        """The model itself."""
        return Model(
            self.robot, self.marker_names, self.markers, self.effects, self.payload, self.gravity
        )

    def _of(self, exact: Model) -> LinearModel:
        return LinearModel(
            exact.robot,
            exact.marker_names,
            exact.markers,
            exact.effects,
            exact.payload,
            exact.gravity,
            self.at,
            self.readings_at_zero,
            self.columns,
            self.known,
        )

    def predict(self, values: Array, poses: Poses) -> Array:
        if poses is not self.at or values.ndim > 1:
            return super().predict(values, poses)
        return np.asarray(self.jacobian(values, poses)[0])

    def _jacobian(self, values: Array, poses: Poses) -> tuple[Array, Array]:
        if poses is not self.at or values.ndim > 1:
            return super()._jacobian(values, poses)
        J = self._own
        return self.readings_at_zero + J @ values, J

    @property
    def _own(self) -> Array:
        """Derivatives by the present parameters, (m, M, 3, p); the same array each time."""
        own = self._last.get("own")
        if own is None:
            chosen = [self.known[id(effect)] for effect in self.effects]
            own = self._last["own"] = self.columns[..., np.concatenate(chosen)]
        return np.asarray(own)


def linearised(
    model: Model, values: Array, poses: Poses, suspects: Sequence[Effect]
) -> LinearModel:
    """A model to first order about some values, with suspects that it may be given.

    values : ndarray, shape (p,); suspects : those that are not in the model stand at nothing
    """
    exact = model.exact if isinstance(model, LinearModel) else model
    whole, everything = exact.extended(values, suspects)
    points, J = whole.jacobian(everything, poses)
    known = {
        id(effect): np.arange(part.start, part.stop)
        for effect, part in zip(whole.effects, whole.slices, strict=True)
    }
    return LinearModel(
        exact.robot,
        exact.marker_names,
        exact.markers,
        exact.effects,
        exact.payload,
        exact.gravity,
        poses,
        points - J @ everything,
        J,
        known,
    )
