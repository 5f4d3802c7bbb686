"""Approach #2 of the paper: every reading of every marker, as it is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, by_size
from calib.observations.protocol import Observation


@dataclass(frozen=True, eq=False)
class Points(Observation):
    """Every number of every reading: of a tracker, every coordinate of every marker.

    centred : subtract the mean of each configuration: only differences between readings at equal
        joints count, what is common to them (geometry) drops out
    """

    centred: bool = False

    def whitened(self, values: Array) -> tuple[Array, Array]:
        predicted, J = self.model.jacobian(values, self.data.poses)
        return self.residuals(predicted), self.rows(J)

    def residuals(self, predicted: Array) -> Array:
        """Weighted residuals, shape (..., m, r C)."""
        off = self.model.readout.difference(self.data.readings, predicted)
        r = self._relative(off[..., None])
        return (self.weights @ r).reshape((*r.shape[:-3], -1))

    def rows(self, J: Array) -> Array:
        """Weighted rows of a Jacobian (..., m, C, r, p), shape (..., m, r C, p)."""
        weighted = self.weights @ self._relative(J)
        return weighted.reshape((*J.shape[:-3], -1, J.shape[-1]))

    def _relative(self, a: Array) -> Array:
        """Subtract the weighted mean of each configuration: what its readings have in common."""
        if not self.centred:
            return a
        out = np.empty_like(a)
        group = self.data.poses.configuration
        information = np.swapaxes(self.weights, -1, -2) @ self.weights
        for index in by_size(group):
            own, here = information[index], a[..., index, :, :, :]
            total, weighted = own.sum(axis=1), (own @ here).sum(axis=-4)
            mean = np.linalg.pinv(total, hermitian=True) @ weighted
            out[..., index, :, :, :] = here - mean[..., None, :, :, :]
        return out


def points_of(observation: Observation, *, centred: bool = False) -> Points:
    """The readings behind an observation, weighed by the instrument: by them poses are judged."""
    o = observation
    scatter = o.known if o.scatter is None else o.scatter
    return Points(o.model, o.data, o.weights, centred, scatter=scatter, pull=o.pull)
