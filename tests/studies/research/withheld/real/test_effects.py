"""Each effect of real arms against its equation, written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("mujoco")

from studies.research.withheld.causes import Cause
from studies.research.withheld.outside import BEYOND
from studies.research.withheld.robots import HEAVY
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import frame_columns
from studies.research.withheld.visible import at_rest
from tests.studies.research.withheld.real.scenes import day_of

JOINT = "A4"
K = 3


def moved(scene: Scene, cause: Cause) -> Array:
    """What one cause does to the readings."""
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    return np.asarray(at_rest(scene, mechanism, [cause]).readings - still.readings)


def last_moves(q: Array) -> Array:
    """Reading by reading: the step that led here, kept while the arm stays, zero at first."""
    found, last = [], np.zeros(q.shape[1])
    for i in range(len(q)):
        if i and not np.array_equal(q[i], q[i - 1]):
            last = q[i] - q[i - 1]
        found.append(last)
    return np.array(found)


@pytest.mark.parametrize("visit", ["once", "free and loaded", "thrice"])
@pytest.mark.parametrize("effect", ["settling", "measured_torque"])
def test_errors_of_joint_variables(effect: str, visit: str) -> None:
    """q_true = q_read + dq: the same points as an arm that is read so much further."""
    scene = day_of(HEAVY, visit)
    measured = np.random.default_rng(1).normal(size=scene.session.q.shape) * 50.0
    scene = replace(scene, measured=measured)
    scene.compliance[K] = 2e-6
    moves = last_moves(scene.session.q)
    longest = np.abs(moves).max(axis=1)
    share = np.divide(moves[:, K], longest, out=np.zeros(len(moves)), where=longest > 0.0)
    values, dq = {
        "settling": (
            {"per_move": 2e-4, "per_speed": 1e-4},
            -(2e-4 * moves[:, K] + 1e-4 * share),
        ),
        "measured_torque": ({"compliance": 1e-6}, 1e-6 * measured[:, K]),
    }[effect]
    mechanism = scene.mechanism()
    state = at_rest(scene, mechanism, [Cause(effect, JOINT, values)])
    read = scene.session.q + scene.compliance * state.torque
    read[:, K] += dq
    np.testing.assert_allclose(state.points, mechanism.posed(read).points, atol=1e-9)


def test_rows_are_the_clock_without_time() -> None:
    """Readings count; the hold-out comes last, after a rest, long after all is warm."""
    scene = day_of(HEAVY, missing="time")
    fitted = ~scene.session.held
    count = int(fitted.sum())
    assert np.all(fitted[:count])
    np.testing.assert_array_equal(scene.clock[:count], np.arange(count))
    assert scene.clock[count:].min() > 3 * count
    assert np.ptp(np.diff(scene.session.time)) == pytest.approx(0.0, abs=1e-9)
    assert not scene.session.moves[count].any()
    np.testing.assert_array_equal(
        scene.session.moves[count + 1], scene.session.q[count + 1] - scene.session.q[count]
    )


def test_two_jumps_walk_and_lag() -> None:
    scene = day_of(HEAVY)
    k, after = HEAVY.names.index(JOINT), (scene.clock >= 400.0).astype(float)
    still = at_rest(scene, scene.mechanism(), ())
    turn = frame_columns(still, k + 1)[..., 3:] @ HEAVY.axes[k]
    jumps = Cause("two_jumps", JOINT, {"offset": 2e-5, "x": 3e-5, "at": 400.0})
    both = (2e-5 * turn + [3e-5, 0.0, 0.0]) * after[:, None, None]
    np.testing.assert_allclose(moved(scene, jumps), both, atol=2e-7)

    walk = Cause("random_walk", "base", {"a": 1e-6, "seed": 4.0})
    one, two = moved(scene, walk), moved(scene, walk.sized(2.0))
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-8)
    many = []
    for seed in range(200):  # the base's origin alone: nothing rotates there
        action = BEYOND["random_walk"].act(scene, still, "base", {"a": 1e-6, "seed": float(seed)})
        many.append(action.twist[:, 0])
    variance = np.mean(np.square(many), axis=0)
    steps = np.arange(1, scene.count + 1)[:, None]
    expected = steps * np.array([1.0, 1.0, 1.0, 0.25, 0.25, 0.25]) * 1e-12
    np.testing.assert_allclose(variance / expected, 1.0, atol=0.5)

    lag = BEYOND["saturating_lag"].act(scene, still, JOINT, {"a": 1e-4, "b": 0.2})
    by_hand = [-1e-4 * np.tanh(m / 0.2) for m in last_moves(scene.session.q)[:, k]]
    np.testing.assert_allclose(lag.joint[:, k], by_hand, atol=1e-15)


def test_cable_bends_the_drives() -> None:
    """A spring on the tip: torque of its force about the axis of a joint that yields."""
    scene = day_of(HEAVY)
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    anchor = np.array([0.5, -0.4, 3.0])
    values = {"a": 0.5, **dict(zip("xyz", anchor.tolist(), strict=True))}
    state = at_rest(scene, mechanism, [Cause("cable_force", "tip", values)])
    k, tip = 2, still.o[:, -1]
    force = 0.5 * (anchor - tip)
    axis = still.R[:, k + 1] @ HEAVY.axes[k]
    torque = np.sum(axis * np.cross(tip - still.o[:, k + 1], force), axis=1)
    change = (state.torque - still.torque)[:, k]
    np.testing.assert_allclose(change, torque, atol=0.02 * np.abs(torque).max())
