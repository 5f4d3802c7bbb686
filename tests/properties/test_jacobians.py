"""Every effect's analytic Jacobian against differences of the full nonlinear model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.effects.protocol import LoadEffect
from calib.model import Model
from calib.poses import Poses
from tests.helpers import central_difference, model_of, random_context, random_poses, random_robot

RNG = np.random.default_rng
# Those of other instruments stand in test_instruments.py.
ANY = random_context(RNG(0), random_robot(RNG(0), 6))
ON_ARM = {kind: effect for kind, effect in EFFECTS.items() if effect.places(ANY)}
SOFT = ["joint_compliance", "tool_compliance"]  # without these, loads move nothing
COMBINATIONS = [
    [kind, *SOFT] if issubclass(effect, LoadEffect) else [kind] for kind, effect in ON_ARM.items()
]
COMBINATIONS.append(list(ON_ARM))


def check_jacobian(model: Model, poses: Poses, values: Array) -> None:
    points, J = model.jacobian(values, poses)
    np.testing.assert_allclose(points, model.predict(values, poses), atol=1e-12)
    numeric = central_difference(lambda v: model.predict(v, poses), values, model.sizes * 1e-2)
    scale = np.abs(J).max(axis=(0, 1, 2))
    # By the moment of a step, or a lag, readings have no derivative.
    smooth = ~np.isin(np.arange(len(model.parameters)), model.still)
    assert (scale > 0.0)[smooth].all(), "every parameter must move a marker here"
    # Rounding of a nanometre equilibrium over the step limits what differences can show.
    noise = 1e-12 / (model.sizes * 1e-2)
    assert (np.abs(J - numeric).max(axis=(0, 1, 2)) <= 1e-6 * scale + 10.0 * noise).all()


@pytest.mark.parametrize("kinds", COMBINATIONS, ids=lambda kinds: "+".join(kinds)[:40])
@pytest.mark.parametrize(("dof", "prismatic"), [(6, ()), (4, (1,)), (2, (0,))])
def test_jacobian(kinds: list[str], dof: int, prismatic: tuple[int, ...]) -> None:
    rng = RNG(dof)
    robot = random_robot(rng, dof, prismatic)
    model = model_of(random_context(rng, robot), kinds)
    poses = random_poses(rng, robot, 12)
    check_jacobian(model, poses, model.initial + model.sizes * rng.normal(size=len(model.sizes)))


@pytest.mark.parametrize("payload", [Payload(), Payload(0.0, (0.1, 0.0, 0.2))])
@pytest.mark.parametrize("measured", [True, False])
def test_jacobian_of_an_unknown_load(payload: Payload, measured: bool) -> None:
    """Where no payload is given: the scale of the measured wrench, or a body nobody wrote down."""
    rng = RNG(1)
    robot = random_robot(rng, 5, (2,))
    context = replace(random_context(rng, robot), payload=payload, measured_load=measured)
    model = model_of(context, ["payload", *SOFT])
    names = [p.name for p in model.parameters if p.effect == "payload"]
    assert names == (["scale", "com_x", "com_y", "com_z"] if measured else ["mass"])
    poses = random_poses(rng, robot, 12)
    check_jacobian(model, poses, model.sizes * rng.normal(size=len(model.parameters)))


def test_trials_are_independent() -> None:
    rng = RNG(5)
    robot = random_robot(rng, 5)
    model, poses = model_of(random_context(rng, robot), list(EFFECTS)), random_poses(rng, robot, 3)
    trials = model.initial + model.sizes * rng.normal(size=(4, len(model.parameters)))
    together, J = model.jacobian(trials, poses)
    for i, values in enumerate(trials):
        alone, J_alone = model.jacobian(values, poses)
        np.testing.assert_allclose(together[i], alone, atol=1e-11)
        np.testing.assert_allclose(J[i], J_alone, rtol=1e-8, atol=1e-9 * np.abs(J_alone).max())
