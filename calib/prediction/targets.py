"""The error to expect at target poses: parameters, arm, model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, in_parts
from calib.effects.readings import ReadingEffect
from calib.model.covariance import errors_at, working_points
from calib.poses import Poses
from calib.prediction.discrepancy import scatter_variance
from calib.prediction.estimate import Estimate
from calib.scatter import Variances


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """Error of the tool points at m targets, by its parts, which are independent.

    Distances are root mean squares over the points of a target, 3-D, in m.
    """

    estimate: Estimate
    targets: Poses

    @cached_property
    def parameters(self) -> Array:
        """Standard error (m,) by the uncertainty of the parameters, less how the instrument errs."""
        model, targets = self.estimate.model, self.targets
        own = np.setdiff1d(np.arange(len(model.parameters)), model.where(ReadingEffect))
        arm = model.with_effects(
            tuple(e for e in model.effects if not isinstance(e, ReadingEffect))
        )
        values, cov = self.estimate.values[own], self.estimate.covariance[np.ix_(own, own)]
        parts = in_parts(len(targets), 3 * len(model.markers) * len(own))
        return np.concatenate([errors_at(arm, values, cov, targets.take(part)) for part in parts])

    @cached_property
    def arm(self) -> Array:
        """Error (m,) of an arm that errs anew at each target; what may be the model's counts here."""
        return self._scatter(self.estimate.of_arm)

    @cached_property
    def model(self) -> Array:
        """Model discrepancy (m,), from configuration to configuration and beside that."""
        return np.hypot(self._scatter(self.estimate.of_model), self.estimate.discrepancy.rms)

    @cached_property
    def rms(self) -> Array:
        """All of it, shape (m,)."""
        return np.asarray(np.sqrt(self.parameters**2 + self.arm**2 + self.model**2))

    def _scatter(self, variances: Variances | None) -> Array:
        model = working_points(self.estimate.model)
        found = scatter_variance(model, self.estimate.values, self.targets, variances)
        return np.asarray(np.sqrt(found.mean(axis=-1)))
