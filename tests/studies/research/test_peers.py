"""The floor beside posecal: its analytic Jacobian is that of its points."""

import numpy as np

from studies.research.peers.drive_scipy import Arm


def test_scipy_driver_has_the_jacobian_of_its_points() -> None:
    rng = np.random.default_rng(0)
    w = rng.normal(size=(3, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    q = rng.uniform(-1, 1, size=(4, 3))
    arm = Arm(w, rng.normal(size=(3, 3)), q, np.zeros((4, 2, 3)))
    x = 0.1 * rng.normal(size=18)
    steps = 1e-6 * np.eye(18)
    slopes = [(arm.errors(x + s) - arm.errors(x - s)) / 2e-6 for s in steps]
    np.testing.assert_allclose(arm.jacobian(x), np.transpose(slopes), atol=1e-8)
