"""What follows from a design at the variances that its rows show: their spread, and coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.inference.design import Design, Variances
from calib.inference.prior import Prior, penalty
from calib.inference.reml import search
from calib.inference.restricted import MixedModel, RestrictedLikelihood


@dataclass(frozen=True, eq=False)
class Marginal:
    """A design at some variances.

    likelihood : RestrictedLikelihood; prior : of the variances
    """

    design: Design
    variances: Variances
    prior: Prior
    likelihood: RestrictedLikelihood

    @classmethod
    def at(cls, design: Design, variances: Variances, prior: Prior | None = None) -> Marginal:
        """The marginal model of a design."""
        model = MixedModel.of(design)
        likelihood = RestrictedLikelihood(model, design.theta(variances))
        return cls(design, variances, prior or Prior(), likelihood)

    @classmethod
    def fitted(cls, design: Design, prior: Prior, start: Variances | None = None) -> Marginal:
        """The same at the variances that restricted likelihood finds."""
        model = MixedModel.of(design)
        theta = search(model, prior, start).theta
        likelihood = RestrictedLikelihood(model, theta)
        return cls(design, design.variances(theta), prior, likelihood)

    @property
    def log_likelihood(self) -> float:
        """Restricted log likelihood."""
        return -0.5 * self.likelihood.value

    @cached_property
    def log_covariance(self) -> Array:
        """Covariance (t, t) of the estimated log variances: instruments, effects, amplitudes^2."""
        known = penalty(self.design, self.prior, self.likelihood.theta).information
        A = self.likelihood.derivatives[1] + np.diag(known)
        size = np.sqrt(np.maximum(np.diag(A), 1e-12))
        scaled = A / np.outer(size, size) + 1e-12 * np.eye(len(A))
        return np.asarray(2.0 * np.linalg.inv(scaled) / np.outer(size, size))

    def posterior(self, name: str) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the coefficients of a block, given all rows."""
        own, names = self.likelihood, [block.name for block in self.design.blocks]
        block = self.design.blocks[names.index(name)]
        mine = self.design.block_of_column == names.index(name)
        root = block.root * self.variances.amplitudes[names.index(name)]
        half = root @ own.inverse[mine]
        return block.mean + root @ own.coefficients[mine], np.asarray(half @ half.T)
