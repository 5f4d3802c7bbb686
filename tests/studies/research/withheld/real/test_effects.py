"""Each effect of real arms against its equation, written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("mujoco")

from studies.research.withheld.causes import Cause
from studies.research.withheld.effects import EFFECTS
from studies.research.withheld.outside import BEYOND
from studies.research.withheld.robots import HEAVY, SCARA, SEVEN
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import frame_columns
from studies.research.withheld.visible import at_rest
from tests.studies.research.withheld.real.scenes import HELD_OUT, day_of

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


def dq_of(effect: str, scene: Scene) -> tuple[dict[str, float], Array]:
    """Values of an effect and the error of the joint's variable that they mean."""
    q, time = scene.session.q[:, K], scene.session.time - scene.session.time[0]
    moves = last_moves(scene.session.q)
    longest = np.abs(moves).max(axis=1)
    share = np.array([m / top if top else 0.0 for m, top in zip(moves[:, K], longest, strict=True)])
    c = 2.0 * 121
    assert scene.measured is not None
    return {
        "gear_ripple": (
            {"cycles": c, "cos_1": 4e-5, "sin_1": -6e-5, "cos_2": 1e-5, "sin_2": 2e-5},
            4e-5 * np.cos(c * q)
            - 6e-5 * np.sin(c * q)
            + 1e-5 * np.cos(2 * c * q)
            + 2e-5 * np.sin(2 * c * q),
        ),
        "warm_up": ({"offset": 1e-4, "tau": 300.0}, 1e-4 * np.exp(-time / 300.0)),
        "step": ({"offset": 1e-4, "at": 400.0}, 1e-4 * (time >= 400.0)),
        "settling": (
            {"per_move": 2e-4, "per_speed": 1e-4},
            -(2e-4 * moves[:, K] + 1e-4 * share),
        ),
        "friction_windup": (
            {"torque": 30.0},
            -30.0 * scene.compliance[K] * scene.session.approach[:, K],
        ),
        "measured_torque": ({"compliance": 1e-6}, 1e-6 * scene.measured[:, K]),
    }[effect]


@pytest.mark.parametrize("visit", ["once", "free and loaded", "thrice"])
@pytest.mark.parametrize("effect", EFFECTS)
def test_errors_of_joint_variables(effect: str, visit: str) -> None:
    """q_true = q_read + dq: the same points as an arm that is read so much further."""
    scene = day_of(HEAVY, visit)
    rng = np.random.default_rng(1)
    scene = replace(scene, measured=rng.normal(size=scene.session.q.shape) * 50.0)
    scene.compliance[K] = 2e-6
    values, dq = dq_of(effect, scene)
    assert np.ptp(dq) > 2e-5
    mechanism = scene.mechanism()
    state = at_rest(scene, mechanism, [Cause(effect, JOINT, values)])
    read = scene.session.q + scene.compliance * state.torque
    read[:, K] += dq
    np.testing.assert_allclose(state.points, mechanism.posed(read).points, atol=1e-9)


@pytest.mark.parametrize("effect", ["warm_up", "step"])
def test_whole_frames_and_one_marker(effect: str) -> None:
    """Base, instrument and marker: rigid displacements to first order, by the clock."""
    scene = day_of(HEAVY)
    time = scene.session.time - scene.session.time[0]
    tuned = {"tau": 300.0} if effect == "warm_up" else {"at": 400.0}
    by = np.exp(-time / 300.0) if effect == "warm_up" else (time >= 400.0).astype(float)
    six = {"x": 3e-5, "y": -1e-5, "rz": 2e-5, **tuned}
    still = at_rest(scene, scene.mechanism(), ())
    x, y = still.points[..., 0], still.points[..., 1]
    rigid = np.stack([3e-5 - 2e-5 * y, -1e-5 + 2e-5 * x, 0.0 * x], axis=-1) * by[:, None, None]
    for where in ("base", "instrument"):  # which stands in the base's origin here
        np.testing.assert_allclose(moved(scene, Cause(effect, where, six)), rigid, atol=1e-8)
    found = moved(scene, Cause("step", "marker:m2", {"x": 0.0, "y": 4e-5, "z": 0.0, "at": 400.0}))
    along = still.R_link[:, -1, :, 1] * 4e-5 * (time >= 400.0)[:, None]
    np.testing.assert_allclose(found[:, 1], along, atol=1e-12)
    np.testing.assert_allclose(found[:, [0, 2]], 0.0, atol=1e-15)


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


def test_visits_and_their_readings() -> None:
    """Thrice: three readings of a stay; each clock begins with a reading that is fitted."""
    for visit, per in (("once", 1), ("free and loaded", 2), ("thrice", 3)):
        for seed in range(6):
            session = day_of(SEVEN, visit, seed=seed).session
            _, stays = np.unique(session.visit, return_counts=True)
            assert set(stays) == {per}
            assert not session.held[0]
            assert len(np.unique(session.q[session.held], axis=0)) == HELD_OUT
            loaded = session.force[:, 2] != 0.0
            assert 0 < loaded.sum() < len(loaded)
            if visit == "thrice":
                assert np.all(loaded.reshape(-1, 3) == loaded[::3, None])


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


def test_scara_needs_no_drive_that_yields() -> None:
    scene = day_of(SCARA)
    assert scene.modelled == ()
    assert np.abs(moved(scene, Cause("backlash", "J1", {"half_width": 1e-4}))).max() > 1e-5
