"""Every effect's analytic Jacobian against differences of the full nonlinear model."""

from __future__ import annotations

import numpy as np
import pytest

from calib.effects import EFFECTS
from tests.helpers import central_difference, model_of, random_context, random_poses, random_robot

COMBINATIONS = [[kind] for kind in EFFECTS if kind != "gravity_compensator"] + [
    ["gravity_compensator", "joint_compliance"],
    list(EFFECTS),
]


@pytest.mark.parametrize("kinds", COMBINATIONS, ids=lambda kinds: "+".join(kinds)[:40])
@pytest.mark.parametrize(("dof", "prismatic"), [(6, ()), (4, (1,)), (2, (0,))])
def test_jacobian(kinds: list[str], dof: int, prismatic: tuple[int, ...]) -> None:
    rng = np.random.default_rng(dof)
    robot = random_robot(rng, dof, prismatic)
    model = model_of(random_context(rng, robot), kinds)
    poses = random_poses(rng, robot, 12)
    values = model.sizes * rng.normal(size=len(model.parameters))
    points, J = model.jacobian(values, poses)
    np.testing.assert_allclose(points, model.predict(values, poses), atol=1e-12)
    numeric = central_difference(lambda v: model.predict(v, poses), values, model.sizes * 1e-2)
    scale = np.abs(J).max(axis=(0, 1, 2))
    assert (scale > 0.0).all(), "every parameter must move a marker here"
    # Rounding of a nanometre equilibrium over the step limits what differences can show.
    noise = 1e-12 / (model.sizes * 1e-2)
    assert (np.abs(J - numeric).max(axis=(0, 1, 2)) <= 1e-6 * scale + 10.0 * noise).all()


def test_trials_are_independent() -> None:
    rng = np.random.default_rng(5)
    robot = random_robot(rng, 5)
    model = model_of(random_context(rng, robot), list(EFFECTS))
    poses = random_poses(rng, robot, 3)
    trials = model.sizes * rng.normal(size=(4, len(model.parameters)))
    together, J = model.jacobian(trials, poses)
    for i, values in enumerate(trials):
        alone, J_alone = model.jacobian(values, poses)
        np.testing.assert_allclose(together[i], alone, atol=1e-11)
        np.testing.assert_allclose(J[i], J_alone, rtol=1e-8, atol=1e-9 * np.abs(J_alone).max())
