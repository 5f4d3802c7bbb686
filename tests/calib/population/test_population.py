"""What a type knows, against types drawn here: linear days of plain numpy, whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calib.arrays import Array
from calib.population import Key, Population, Prior, adapted, departure, loosened, population
from calib.population.hierarchy import RobotEstimate

P = 12
KEYS: tuple[Key, ...] = tuple(("geometry", f"j{k // 3}", "xyz"[k % 3]) for k in range(P))
SIZES = np.geomspace(1e-4, 1e-2, P)


@dataclass(frozen=True)
class Type:
    """Robots err by ``mean + L z``, SI; some parameters go together."""

    mean: Array
    L: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Type:
        together = np.eye(P) + 0.5 * rng.normal(size=(P, P)) * (rng.random((P, P)) < 0.15)
        together /= np.linalg.norm(together, axis=1, keepdims=True)
        spread = SIZES * 10 ** rng.uniform(-1.0, 0.0, P)
        return cls(rng.normal(size=P) * SIZES, spread[:, None] * together)

    def robot(self, rng: np.random.Generator) -> Array:
        return self.mean + self.L @ rng.normal(size=P)


def readings(theta: Array, rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """A day: rows J in standard deviations, and what was read."""
    J = rng.normal(size=(rows, P)) * 10 ** rng.uniform(-1.0, 1.0, P) / SIZES
    return J, J @ theta + rng.normal(size=rows)


def alone(name: str, theta: Array, rng: np.random.Generator) -> RobotEstimate:
    J, y = readings(theta, 40, rng)
    C = np.linalg.inv(J.T @ J)
    return RobotEstimate(name, C @ J.T @ y, C, np.zeros((P, 0)))


def learnt(own: Type, count: int, rng: np.random.Generator) -> Population:
    robots = [alone(f"r{i}", own.robot(rng), rng) for i in range(count)]
    return population("arm", KEYS, SIZES, robots)


def beside(prior: Prior, J: Array, y: Array) -> tuple[Array, Array]:
    """Mean and covariance under a normal prior, by the normal equations."""
    scaled = prior.covariance / np.outer(SIZES, SIZES)
    S = np.linalg.inv(scaled) / np.outer(SIZES, SIZES)
    C = np.linalg.inv(J.T @ J + S)
    return C @ (J.T @ y + S @ prior.mean), C


def held(prior: Prior, theta: Array, rows: int, rng: np.random.Generator) -> tuple[Array, bool]:
    """Which 95 % intervals hold, and whether the robot is said to be of the type."""
    J, y = readings(theta, rows, rng)
    loose = loosened(prior, SIZES)
    found = departure(prior, *beside(loose, J, y), SIZES)
    values, C = beside(adapted(found, SIZES), J, y)
    return np.abs(values - theta) < 1.96 * np.sqrt(np.diag(C)), found.of_the_type


@pytest.mark.parametrize("robots", [10, 100])
def test_intervals_hold_for_one_robot_more_and_few_are_called_strangers(robots: int) -> None:
    """Over days of four rows to forty, for a dozen parameters: the type's part is large and small."""
    rng = np.random.default_rng(3)
    every, tail, strangers = [], [], []
    for _ in range(8):
        own = Type.drawn(rng)
        prior = learnt(own, robots, rng).prior
        for _ in range(100):
            z = rng.normal(size=P)
            hit, of_the_type = held(prior, own.mean + own.L @ z, int(rng.integers(4, 40)), rng)
            every.append(hit)
            strangers.append(not of_the_type)
            if z @ z > 18.5:  # one in ten lies so far out
                tail.append(hit)
    assert 0.93 < np.mean(every) < 0.97
    assert len(tail) > 50
    assert 0.92 < np.mean(tail) < 0.97
    assert np.mean(strangers) < 0.04


@pytest.mark.long
@pytest.mark.parametrize("together", [0.0, 0.9])
def test_intervals_hold_at_the_edge_of_a_type(together: float) -> None:
    """One in twenty stands farther out; the type is known, so that no doubt about it helps."""
    rng, hits = np.random.default_rng(8), []
    for _ in range(5):
        signs = rng.choice([-1.0, 1.0], P)
        R = together * np.outer(signs, signs) + (1.0 - together) * np.eye(P)
        spread = SIZES * 10 ** rng.uniform(-1.0, 0.0, P)
        own = Type(rng.normal(size=P) * SIZES, spread[:, None] * np.linalg.cholesky(R))
        prior = Prior("arm", KEYS, own.mean, own.L @ own.L.T, 1000)
        for _ in range(100):
            z = rng.normal(size=P)
            z *= np.sqrt(21.03 / (z @ z))  # chi-square of twelve: 0.95
            hits.append(held(prior, own.mean + own.L @ z, int(rng.integers(4, 40)), rng)[0])
    assert 0.925 < np.mean(hits) < 0.97


def test_few_are_called_strangers_where_parameters_go_together() -> None:
    """A test of 1 %, of types that are learnt from ten robots: by a chi-square it called 6.6 %."""
    rng, strangers = np.random.default_rng(6), []
    for _ in range(50):
        R = 0.7 + 0.3 * np.eye(P)
        spread = SIZES * 10 ** rng.uniform(-1.0, 0.0, P)
        own = Type(rng.normal(size=P) * SIZES, spread[:, None] * np.linalg.cholesky(R))
        robots = [RobotEstimate(str(i), own.robot(rng), 1e-6 * np.diag(SIZES**2), np.zeros((P, 0)))
                  for i in range(10)]  # fmt: skip
        prior = population("arm", KEYS, SIZES, robots).prior
        strangers += [not held(prior, own.robot(rng), 40, rng)[1] for _ in range(10)]
    assert np.mean(strangers) < 0.025


@pytest.mark.long
def test_a_robot_that_is_not_of_the_type_is_said_and_not_absorbed() -> None:
    rng = np.random.default_rng(4)
    own = Type.drawn(rng)
    prior = learnt(own, 30, rng).prior
    hits, told = [], []
    for k in range(100):
        theta = own.robot(rng)
        theta[k % P] += 8.0 * SIZES[k % P]
        hit, of_the_type = held(prior, theta, 30, rng)
        hits.append(hit)
        told.append(not of_the_type)
    assert np.mean(told) > 0.9  # the readings of some days hardly see that parameter
    assert 0.93 < np.mean(hits) < 0.975


def test_what_was_not_determined_says_nothing() -> None:
    """Least squares left one parameter at zero and put its share into another."""
    rng = np.random.default_rng(5)
    own = Type.drawn(rng)
    robots = []
    for i in range(40):
        J, y = readings(own.robot(rng), 30, rng)
        J[:, 1] = 2.0 * J[:, 0] * SIZES[0] / SIZES[1]  # no pose tells them apart
        y = J @ own.robot(rng) + rng.normal(size=30)
        kept = np.delete(np.arange(P), 1)
        C = np.zeros((P, P))
        C[np.ix_(kept, kept)] = np.linalg.inv(J[:, kept].T @ J[:, kept])
        V = np.zeros((P, 1))
        V[1], V[0] = SIZES[1], -2.0 * SIZES[0]
        robots.append(RobotEstimate(f"r{i}", C @ J.T @ y, C, V))
    robots += [alone(f"w{i}", own.robot(rng), rng) for i in range(40)]
    found = population("arm", KEYS, SIZES, robots)
    true = np.sqrt(np.diag(own.L @ own.L.T))
    off = (found.prior.mean - own.mean) / (true / np.sqrt(40))
    assert np.abs(off).max() < 4.0
    assert (found.spread / true > 0.6).all()
    assert (found.spread / true < 1.6).all()


def test_few_robots_stay_near_the_plausible_sizes_and_many_leave_them() -> None:
    rng = np.random.default_rng(6)
    own = Type(np.zeros(P), np.diag(0.05 * SIZES))
    share = [np.median(learnt(own, n, rng).prior.std / SIZES) for n in (0, 1, 3, 10, 100)]
    assert share == sorted(share, reverse=True)
    assert share[0] > 1.0
    assert share[1] > 0.5
    assert 0.05 < share[3] < 0.15
    assert 0.045 < share[4] < 0.06


def test_one_robot_of_another_type_does_not_count() -> None:
    rng = np.random.default_rng(7)
    own = Type.drawn(rng)
    robots = [alone(f"r{i}", own.robot(rng), rng) for i in range(15)]
    stranger = robots[4].values.copy()
    stranger[3] += 30.0 * SIZES[3]
    robots[4] = RobotEstimate("stranger", stranger, robots[4].noise, robots[4].open)
    found = population("arm", KEYS, SIZES, robots)
    assert [one.name for one in found.aside] == ["stranger"]
    assert found.prior.robots == 14
    assert found.spread[3] < 3.0 * np.linalg.norm(own.L[3])
