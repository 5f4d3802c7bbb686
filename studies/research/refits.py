"""Fits of simulated days beside what was promised for their plan."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

import calib
from calib.arrays import Array
from studies.compare.experiment import POINTS, SimulatedExperiment
from studies.compare.prediction import predict


@dataclass(frozen=True, eq=False)
class Refits:
    """How fits scatter about their mean, (days, k), beside the covariance (k, k) that was predicted.

    Where an instrument stands takes up what the true robot's first frame is off by, and is left out.
    """

    scatter: Array
    covariance: Array

    @classmethod
    def of(cls, experiment: SimulatedExperiment, fits: Iterable[calib.Identification]) -> Refits:
        """Fits may have further parameters."""
        cov, own = predict(experiment, POINTS).covariance, experiment.model.parameters
        kept = [k for k, p in enumerate(own) if p.effect != "base" and cov[k, k] > 0.0]
        estimates = []
        for fit in fits:
            at = {p.id: v for p, v in zip(fit.model.parameters, fit.values, strict=True)}
            estimates.append([at[own[k].id] for k in kept])
        scatter = np.array(estimates) - np.mean(estimates, axis=0)
        return cls(scatter, cov[np.ix_(kept, kept)])

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the chi-square of all parameters."""
        return (len(self.scatter) - 1) * len(self.covariance)

    @property
    def statistic(self) -> float:
        """Chi-square of all parameters together."""
        inverse = np.linalg.inv(self.covariance)
        return float(np.einsum("ni,ij,nj->", self.scatter, inverse, self.scatter))

    @property
    def over_foreseen(self) -> float:
        """Squared scatter over the predicted one: 1 is perfect."""
        return self.statistic / self.freedom

    @property
    def p(self) -> float:
        """Share of plans as promised whose fits scatter more."""
        from scipy.stats import chi2

        return float(chi2.sf(self.statistic, self.freedom))
