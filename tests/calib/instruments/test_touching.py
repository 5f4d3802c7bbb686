"""Sockets, distances and planes: derivatives, rank, and the scatter that the covariance says.

The truth is plain numpy: a chain, surfaces and contacts that share no code with the estimator. A
contact is made by moving the joints until the marker is where it belongs, its noise aside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import calib
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.instruments import Distance, Instrument, KnownDistance, Plane, Socket
from calib.model.build import build
from calib.poses import Measurements, poses_at
from tests.calib.instruments.test_slot import (
    OFF,
    OFFSETS,
    TRUE,
    arm,
    cell_with,
    drawn,
    measured,
    points_of,
    slopes,
)
from tests.helpers import cell_of, central_difference, random_robot

SIGMA = 2e-5
_TRIALS = 6
ONE = np.array([[0.10, 0.02, -0.05]])
CENTRE = np.array([0.7, -0.5, 0.4])
TILT = np.array([0.3, -0.4])


def normal_of(tilt: Array) -> Array:
    """The vertical turned about a horizontal axis, by hand."""
    angle = np.hypot(*tilt)
    x, y = tilt / angle
    return np.array([y * np.sin(angle), -x * np.sin(angle), np.cos(angle)])


def length(v: Array) -> Array:
    return np.asarray(np.sqrt((v**2).sum(axis=-1)))


@dataclass(frozen=True, eq=False)
class Kind:
    """An instrument, its true place, and its reading of points (m, 3) at site (m,), by hand.

    touched : whether the reading is made zero by moving the arm
    """

    instrument: Instrument
    place: Array
    reading: Callable[[Array, Array, Array], Array]
    touched: bool = False
    sites: tuple[str, ...] = ()


def socket(p: Array, place: Array, site: Array) -> Array:
    return p - place.reshape(-1, 3)[site]


def distance(p: Array, place: Array, site: Array) -> Array:
    return (length(p - place[:3]) + (place[3] if len(place) > 3 else 0.0))[:, None]


def known_anchor(p: Array, place: Array, site: Array) -> Array:
    return (length(p - CENTRE) + place[0])[:, None]


def plane(p: Array, place: Array, site: Array) -> Array:
    return (p @ normal_of(place[:2]) - place[2])[:, None]


FLAT = np.array([*TILT, 0.35])
KINDS = {
    "distance": Kind(Distance(name="own", sigma=SIGMA), CENTRE, distance),
    "distance with offset": Kind(
        Distance(name="own", sigma=SIGMA, offset=True), np.array([*CENTRE, -0.2]), distance
    ),
    "distance from a known anchor": Kind(
        Distance(name="own", sigma=SIGMA, anchor=CENTRE, known=True, offset=True),
        np.array([0.1]),
        known_anchor,
    ),
    "gauge over a plane": Kind(Plane(name="own", sigma=SIGMA), FLAT, plane),
    "plane": Kind(Plane(name="own", sigma=SIGMA), FLAT, plane, touched=True),
    "sockets": Kind(
        Socket(name="a", sigma=SIGMA, sites=("a", "b")),
        np.array([0.5, 0.2, 0.6, -0.4, 0.3, 0.2]),
        socket,
        touched=True,
        sites=("a", "b"),
    ),
}


def parts(kind: Kind, theta: Array, q: Array, site: Array) -> Array:
    """Readings (m, r) by offsets and place."""
    return kind.reading(points_of(arm(), q, theta[:3], ONE)[:, 0], theta[3:], site)


def toward(kind: Kind, theta: Array, q: Array, site: Array) -> Array:
    """How joints (m, 4) follow the readings, shape (m, 4, r)."""
    steps = 1e-6 * np.eye(4)
    ends = [parts(kind, theta, q + h, site) - parts(kind, theta, q - h, site) for h in steps]
    return np.linalg.pinv(np.stack(ends, axis=-1) / 2e-6, rcond=1e-3)


def reached(kind: Kind, theta: Array, count: int) -> tuple[Array, Array]:
    """Joints (count, 4) at which the readings are zero, by Newton's steps, and sites (count,)."""
    q = drawn((10 if kind.sites else 4) * count, 5)
    site = np.arange(len(q)) % max(1, len(kind.sites))
    for _ in range(12):
        off = -parts(kind, theta, q, site)
        step = (toward(kind, theta, q, site) @ off[..., None])[..., 0]
        q = q + step * np.minimum(1.0, 0.4 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
    there = np.flatnonzero(np.abs(parts(kind, theta, q, site)).max(axis=1) < 1e-9)[:count]
    assert len(there) == count
    return q[there], site[there]


@pytest.mark.parametrize("name", KINDS)
def test_covariance_rank_and_refits(name: str) -> None:
    """Found without a guess, of full rank; errors scatter as the information by hand says."""
    kind, m = KINDS[name], 16
    theta, rng, squared = np.concatenate([TRUE, kind.place]), np.random.default_rng(1), []
    q, site = drawn(m, 0), np.zeros(m, dtype=int)
    if kind.touched:
        q, site = reached(kind, theta, m)
        gain = toward(kind, theta, q, site)
    J = slopes(lambda t: parts(kind, t, q, site), theta) / SIGMA
    expected = np.linalg.inv(J.T @ J)
    cell = cell_with(kind.instrument, effects=("base", OFF))
    cell = replace(cell, markers=ONE, marker_names=("m1",))
    exact = parts(kind, theta, q, site)
    for _ in range(_TRIALS):
        noise = SIGMA * rng.standard_normal(exact.shape)
        if kind.touched:  # the arm is elsewhere, and what is read is nothing
            data = measured(q + (gain @ noise[..., None])[..., 0], np.zeros_like(exact)[:, None])
        else:
            data = measured(q, (exact + noise)[:, None])
        if kind.sites:
            named = np.array(kind.sites)[site]
            data = replace(data, poses=replace(data.poses, site=named))
        found = calib.identify(cell, data)
        ids = [p.id for p in found.model.parameters]
        at = [ids.index(f"joint_offset:{j}.offset") for j in OFFSETS]
        at += [i for i, own in enumerate(ids) if own.startswith("base:")]
        assert found.status == "converged"
        assert found.rank == len(theta) == len(ids)
        error = found.values[at] - theta
        squared.append(error @ np.linalg.solve(expected, error))
        stated = found.std[at] / found.noise.factor
        np.testing.assert_allclose(stated, np.sqrt(np.diag(expected)), rtol=0.05)
    # Chi-square, four standard deviations.
    dof = float(_TRIALS * len(theta))
    assert sum(squared) == pytest.approx(dof, abs=4.0 * np.sqrt(2.0 * dof))


def test_derivatives_of_a_known_distance() -> None:
    """Between two markers that are free."""
    cell = cell_with(KINDS["plane"].instrument, effects=("base", "tool", "joint_offset:j2,j3"))
    cell = replace(cell, known_distances=(KnownDistance(("m1", "m2"), 0.1, 1e-5),))
    model = build(cell, poses_at(drawn(6, 4))).model
    values = np.random.default_rng(3).normal(size=len(model.parameters)) * 10.0 * model.sizes
    _, by_known = model.prior_residuals(values)
    numeric = central_difference(lambda v: -model.prior_residuals(v)[0], values, 0.1 * model.sizes)
    np.testing.assert_allclose(by_known, numeric, rtol=1e-6, atol=1e-6 * np.abs(by_known).max())


SCALE = 1.002
SITES = ("a", "b", "c", "d")


def contacts_of_a_larger_arm(robot: Robot) -> tuple[Measurements, Array]:
    """Contacts of an arm whose every length is larger than in its model, and its four sockets."""
    true = replace(robot, origins=robot.origins.copy())
    true.origins[:, :3, 3] *= SCALE
    rng, still = np.random.default_rng(6), np.zeros(3)

    def ball(q: Array) -> Array:
        return points_of(true, q, still, SCALE * ONE)[:, 0]

    centres = ball(rng.uniform(-2.0, 2.0, (4, 6)))
    q = rng.uniform(-2.0, 2.0, (120, 6))
    site = np.arange(len(q)) % 4
    for _ in range(15):
        ends = [ball(q + h) - ball(q - h) for h in 1e-6 * np.eye(6)]
        follow = np.linalg.pinv(np.stack(ends, axis=-1) / 2e-6, rcond=1e-3)
        off = centres[site] - ball(q)
        step = (follow @ off[..., None])[..., 0]
        q = q + step * np.minimum(1.0, 0.4 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
    there = length(centres[site] - ball(q)) < 1e-9
    data = measured(q[there], np.zeros((int(there.sum()), 1, 3)))
    named = np.array(SITES)[site[there]]
    return replace(data, poses=replace(data.poses, site=named)), centres


def test_scale_from_a_known_distance() -> None:
    """One pair a known way apart tells how large the arm is; without one it stays as in the model."""
    robot = random_robot(np.random.default_rng(12), 6)
    data, centres = contacts_of_a_larger_arm(robot)
    assert len(data) > 60
    cell = cell_of(robot, ONE + np.array([0.08, -0.05, 0.06]), ("tool", "geometry"))
    cell = replace(cell, instruments=(Socket(name="a", sigma=SIGMA, sites=SITES),))
    apart = length(centres[0] - centres[1])
    bar = KnownDistance(("a", "b"), float(apart), 1e-6)

    def between_c_and_d(found: calib.Identification) -> float:
        ids = [p.id for p in found.model.parameters]
        c, d = (found.values[[ids.index(f"base:{s}.{x}") for x in "xyz"]] for s in "cd")
        return float(length(c - d))

    truth = float(length(centres[2] - centres[3]))
    found = calib.identify(replace(cell, known_distances=(bar,)), data)
    assert found.rms("fitted") == pytest.approx(0.0, abs=1e-7)
    assert between_c_and_d(found) == pytest.approx(truth, abs=2e-6)
    assert not any("no length" in text for text in found.warnings)
    without = calib.identify(cell, data)
    assert without.rms("fitted") == pytest.approx(0.0, abs=1e-7)
    assert any("no length is measured" in text for text in without.warnings)
    assert len(without.values) == len(found.values) - 1
    assert abs(between_c_and_d(without) / truth - 1.0) < 0.01
