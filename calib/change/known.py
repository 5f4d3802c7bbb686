"""What one result knows of a robot, without the cell that it was made in."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.compensation.estimate import estimate_of
from calib.identification.identification import Identification
from calib.population.prior import Key
from calib.poses import Poses
from calib.uncertainty.expanded import freedom

_CHANCE = 3.0  # standard deviations of a mean square
# Numbers that a parameter is taken from at one pose. Of two days that are compared fewer than the stays
# give, so that false alarms are held.
_COORDINATES = 3


@dataclass(frozen=True, eq=False)
class DayEstimate:
    """The estimate of one day.

    keys : tuple of Key; values : ndarray, shape (p,), SI
    covariance : ndarray, shape (p, p), SI, with what was not determined at its plausible size
        (:attr:`calib.compensation.Estimate.covariance`)
    lost : ndarray of bool, shape (p,), what was not determined
    markers : dict, name -> ndarray, shape (3,), m, tip frame
    dof : float, degrees of freedom behind the covariance, infinite where the noise was known
    left : float, m, RMS that the fit leaves, 3-D per point; approaches : float, degrees of freedom of
        that, a pose counting as one; excess : float, m, what of it is surely not the instrument
    poses : Poses that were fitted, or None
    """

    keys: tuple[Key, ...]
    values: Array
    covariance: Array
    lost: Mask
    markers: Mapping[str, Array]
    dof: float
    left: float = 0.0
    approaches: float = 1.0
    excess: float = 0.0
    poses: Poses | None = None

    @classmethod
    def of_fit(
        cls,
        covariance: Array,
        *,
        keys: tuple[Key, ...],
        values: Array,
        lost: Mask,
        markers: Mapping[str, Array],
        noise_dof: float,
        sigma: float,
        scatters: bool,
        left: float,
        counts: tuple[int, int],
        poses: Poses | None,
    ) -> DayEstimate:
        """An estimate of a day from values, covariance and noise of its fit.

        noise_dof, sigma : behind its noise level, and m, of one coordinate of the instrument as stated
        scatters : whether poses err as a whole; counts : of poses and points that were fitted
        """
        free, chance = approaches(counts[0], len(keys)), np.sqrt(2.0 / (3.0 * counts[1]))
        surely = left**2 > 3.0 * sigma**2 * (1.0 + _CHANCE * chance)
        return cls(
            keys,
            values,
            covariance,
            lost,
            markers,
            dof=free if scatters else max(1.0, noise_dof),
            left=left,
            approaches=free,
            excess=float(np.sqrt(left**2 - 3.0 * sigma**2)) if surely else 0.0,
            poses=poses,
        )

    def restricted(self, gone: Collection[Key]) -> DayEstimate:
        """The same data under a model without some parameters: their values are zero.

        Least squares under a linear restriction: values and covariance given that these are zero.
        """
        if not gone:
            return self
        out = np.array([key in gone for key in self.keys])
        cross = self.covariance[np.ix_(~out, out)]
        block = self.covariance[np.ix_(out, out)]
        std = np.sqrt(np.where(np.diag(block) > 0.0, np.diag(block), 1.0))
        gain = cross / std @ np.linalg.pinv(block / np.outer(std, std), hermitian=True) / std
        return replace(
            self,
            keys=tuple(key for key in self.keys if key not in gone),
            values=self.values[~out] - gain @ self.values[out],
            covariance=self.covariance[np.ix_(~out, ~out)] - gain @ cross.T,
            lost=self.lost[~out],
        )

    def ignorance(self) -> tuple[tuple[Key, ...], Array]:
        """What was not determined, and how all values follow it, shape (p, u), SI: ``V V^T`` of
        :func:`calib.model.covariance.ignorance`, each column for an error of the plausible size.
        """
        own = np.flatnonzero(self.lost)
        sizes = np.sqrt(np.diag(self.covariance)[own])
        return tuple(self.keys[i] for i in own), self.covariance[:, own] / sizes

    def noise(self) -> Array:
        """Covariance by the noise alone, shape (p, p), SI."""
        _, V = self.ignorance()
        return np.asarray(self.covariance - V @ V.T)


def approaches(poses: int, parameters: int) -> float:
    """Degrees of freedom where the points of a pose err together."""
    return freedom(np.inf, poses, parameters, as_a_whole=True, numbers=_COORDINATES)


def known_of(found: Identification) -> DayEstimate:
    """The estimate of one day from its identification."""
    estimate, model = estimate_of(found), found.model
    fitted = found.fit.data.take(~found.fit.outlier)
    return DayEstimate.of_fit(
        estimate.covariance,
        keys=model.keys,
        values=found.values,
        lost=np.array([p.id in estimate.undetermined for p in model.parameters]),
        markers=dict(zip(model.marker_names, found.marker_positions, strict=True)),
        noise_dof=found.noise.dof,
        sigma=found.noise.believed,
        scatters=estimate.variances is not None and estimate.variances.any,
        left=found.rms("fitted") or found.rms("fitted_all") or 0.0,
        counts=(len(fitted), int(fitted.seen.sum())),
        poses=fitted.poses,
    )
