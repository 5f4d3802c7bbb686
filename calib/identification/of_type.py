"""An identification beside the robot's type: how far it left that, and how much of it still holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.identification.estimators import Estimator
from calib.identification.search import Found, search
from calib.model import Model
from calib.observations import Observation
from calib.population import Departure, adapted, departure, loosened


def by_itself(model: Model) -> Model:
    """The model under which the readings are judged first: they speak for themselves."""
    if model.own_prior is None:
        return model
    return replace(model, prior=loosened(model.own_prior, model.sizes[model.own_prior_at]))


def held_by_type(
    estimator: Estimator, observation: Observation, loose: Found, covariance: Array, pull: float
) -> tuple[Observation, Found, Departure]:
    """The estimate beside what of the type is believed of this robot.

    observation : with the type as it is; loose : under the model :func:`by_itself`
    covariance : ndarray, shape (p, p), of its values; pull : actual over stated noise of the readings
    """
    model, values = observation.model, loose.best.values
    if model.own_prior is None:
        raise ValueError("a model without a type")
    at, prior = model.own_prior_at, model.own_prior
    own, sizes = covariance[np.ix_(at, at)], model.sizes[at]
    found = replace(departure(prior, values[at], own, sizes), pull=pull)
    believed = replace(model, prior=adapted(found, sizes))
    observation = replace(observation, model=believed, pull=pull)
    return observation, search(estimator, observation, values), found
