"""How many poses robot N + 1 of a type needs, after N of them: predicted, and simulated.

    python -m studies.research.benchmarks.types [--robots 8] [--sigma-mm 0.1] [--goal-mm 0.2] [--seed 0]
        [--json FILE]

The KR 270 of the demonstration with base, tool and geometry, three markers. The type's mean is off by a
third of the plausible sizes, its robots differ from it by a tenth to a thirtieth of them. What N robots
tell comes from as many days of 20 random poses, drawn to first order. Robots after them are simulated
in full at random poses and go through ``calib.identify``. Poses are counted until the RMS error at 200
targets is below the goal and stays there: predicted by the type and the poses alone before anything is
read, and true, by the simulated robot. ``held`` is the share of 95 % intervals that hold over all these
identifications; ``tail`` over the half of robots farthest from the mean; ``strangers`` counts
identifications called not of the type, without and with the third joint knocked by 2 mrad.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import accuracy, covariance
from calib.noise import Noise
from calib.population import Prior, population
from calib.population.hierarchy import RobotEstimate
from calib.poses import Poses, poses_at
from calib.simulation import drawn_readings
from studies.research.bench import Output, Row, bench, count, each, median_or_more, table
from studies.research.benchmarks.changes import PLACE, arms

LEARNT = (0, 1, 3, 10, 100)
POSES = (2, 3, 4, 5, 6, 8, 11, 15, 20, 28)
DAY = 20
_MEAN, _SPREAD = 1 / 3, (1 / 30, 1 / 10)  # plausible sizes
_KNOCK = 2e-3


@dataclass(frozen=True, eq=False)
class Type:
    """Robots of one model: mean and spread, (k,), SI, of the parameters at ``own``."""

    cell: Cell
    model: Model
    own: Array
    mean: Array
    spread: Array

    def robot(self, rng: np.random.Generator) -> tuple[Array, float]:
        """A robot's values, (p,), and how far it is from the mean, in spreads."""
        z = rng.normal(size=len(self.own))
        values = self.model.initial
        values[self.own] = self.mean + self.spread * z
        values[[p.effect == "base" for p in self.model.parameters]] = PLACE
        return values, float(np.sqrt(np.mean(z**2)))

    def poses(self, count: int, rng: np.random.Generator) -> Poses:
        low, high = self.cell.robot.sample_limits().T
        return poses_at(rng.uniform(low, high, (count, len(low))))


@dataclass(frozen=True)
class Outcome:
    """One robot after N others: poses that it needs, and its intervals that held, of how many."""

    before: int
    predicted: int | None
    needed: int | None
    distance: float
    held: int
    intervals: int
    strange: tuple[bool, ...]
    knocked: tuple[bool, ...]


def drawn_type(sigma: float, rng: np.random.Generator) -> Type:
    """A type whose cells read points to sigma, m."""
    arm = arms()[0]
    cell = replace(arm, instruments=(replace(arm.tracker, noise=Noise(sigma, sigma)),))
    model = build(cell).model
    own = np.array([i for i, p in enumerate(model.parameters) if p.effect not in ("base", "tool")])
    sizes = model.sizes[own]
    share = np.geomspace(*_SPREAD, len(own))[rng.permutation(len(own))]
    mean = _MEAN * sizes * rng.normal(size=len(own))
    return Type(cell, model, own, mean, share * sizes)


def learnt(of: Type, count: int, rng: np.random.Generator) -> Prior:
    """What so many robots tell, each of a day to first order."""
    robots = []
    for i in range(count):
        values, _ = of.robot(rng)
        _, J = of.model.jacobian(values, of.poses(DAY, rng))
        J = J.reshape(-1, J.shape[-1]) / of.cell.noise.along
        cov = covariance(J, np.eye(len(values)))[np.ix_(of.own, of.own)]
        found = values[of.own] + np.linalg.cholesky(cov) @ rng.normal(size=len(of.own))
        robots.append(RobotEstimate(str(i), found, cov, np.zeros((len(of.own), 0))))
    keys = of.model.keys
    names = tuple(keys[i] for i in of.own)
    return population(of.cell.robot.name, names, of.model.sizes[of.own], robots).prior


def predicted(of: Type, prior: Prior, poses: Poses) -> float:
    """Expected RMS error at the targets before anything is read, m."""
    model = replace(of.model, prior=prior)
    values = model.initial
    values[of.own] = prior.mean
    _, J = model.jacobian(values, poses)
    rows = np.concatenate([J.reshape(-1, J.shape[-1]) / of.cell.noise.along, model.by_prior])
    if np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=0)) < rows.shape[1]:
        return np.inf
    cov = covariance(rows, np.eye(len(values)))
    return accuracy(model, values, cov, *targets_of(of.cell))[0]


def true_error(of: Type, found: calib.Identification, truth: Array) -> float:
    """RMS error at the targets, m."""
    targets, _ = targets_of(of.cell)
    off = found.model.predict(found.values, targets) - of.model.predict(truth, targets)
    return float(np.sqrt((off**2).sum(axis=-1).mean()))


def outcome(of: Type, prior: Prior, before: int, goal: float, rng: np.random.Generator) -> Outcome:
    """One robot more, measured with more and more poses."""
    truth, distance = of.robot(rng)
    order = of.poses(max(POSES), rng)
    cell = replace(of.cell, prior=prior)
    bounds = [predicted(of, prior, order.take(slice(n))) for n in POSES]
    errors, held, strange, knocked = list[float](), list[bool](), list[bool](), list[bool]()
    for n in POSES:
        data = drawn_readings(of.model, truth, order.take(slice(n)), of.cell.noise, rng)
        try:
            found = calib.identify(cell, data)
        except CalibError:
            errors.append(np.inf)
            continue
        errors.append(true_error(of, found, truth))
        low, high = found.interval()[of.own].T
        held += ((low <= truth[of.own]) & (truth[of.own] <= high)).tolist()
        strange.append(found.of_type is not None and not found.of_type.of_the_type)
    hit = truth.copy()
    keys = of.model.keys
    hit[of.own[[keys[i][1] == "A3" and keys[i][2].startswith("r") for i in of.own]][0]] += _KNOCK
    for n in POSES[-2:]:
        found = calib.identify(
            cell, drawn_readings(of.model, hit, order.take(slice(n)), of.cell.noise, rng)
        )
        knocked.append(found.of_type is not None and not found.of_type.of_the_type)
    first = partial(_first_below, goal=goal)
    return Outcome(before, first(bounds), first(errors), distance, sum(held), len(held),
                   tuple(strange), tuple(knocked))  # fmt: skip


def _first_below(errors: list[float], goal: float) -> int | None:
    """Poses from which on all errors are below the goal."""
    above = [k for k, error in enumerate(errors) if error > goal]
    after = above[-1] + 1 if above else 0
    return POSES[after] if after < len(POSES) else None


def _row(own: list[Outcome]) -> Row:
    far = sorted(own, key=lambda one: -one.distance)[: len(own) // 2]
    held, tail = (
        sum(o.held for o in of) / max(sum(o.intervals for o in of), 1) for of in (own, far)
    )
    strange = [s for o in own for s in o.strange]
    knocked = [s for o in own for s in o.knocked]
    return {
        "robots before": own[0].before,
        "poses predicted": median_or_more([o.predicted for o in own], max(POSES)),
        "poses simulated": median_or_more([o.needed for o in own], max(POSES)),
        "held": f"{held:.3f}",
        "tail": f"{tail:.3f}",
        "strangers": f"{sum(strange)} of {len(strange)}",
        "knocked": f"{sum(knocked)} of {len(knocked)}",
    }


def after_others(
    before: int, *, robots: int, sigma: float, goal: float, seed: int
) -> list[Outcome]:
    """Robots after so many others, each of a type of its own; sigma, goal : m."""
    rng = np.random.default_rng([seed, before])
    own = []
    for _ in range(robots):
        of = drawn_type(sigma, rng)
        own.append(outcome(of, learnt(of, before, rng), before, goal, rng))
    return own


@bench(
    count("--robots", 8, help="After each number of others."),
    click.option("--sigma-mm", default=0.1, show_default=True, help="Of a coordinate of a point."),
    click.option("--goal-mm", default=0.2, show_default=True, help="RMS error at the targets."),
    workers=True,
)
def main(workers: int, sigma_mm: float, goal_mm: float, **options: Any) -> Output:
    """Poses that one robot more needs, by how many of its type are known."""
    sizes = {"sigma": sigma_mm * 1e-3, "goal": goal_mm * 1e-3}
    found = each(after_others, ((before,) for before in LEARNT), workers, **sizes, **options)
    return [table(map(_row, found))], [asdict(one) for own in found for one in own]


if __name__ == "__main__":
    main()
