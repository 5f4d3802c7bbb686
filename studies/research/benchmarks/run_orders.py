"""What a planned order tells of errors that depend on it, against the same poses in an order by chance.

    python -m studies.research.benchmarks.run_orders [--days 50] [--refits 40] [--only NAME ..]
        [--workers 2] [--real] [--json FILE]

A light arm of six joints is read by a tracker at thirty poses. Three days are compared: the plan for a
model that has the error, the plan for one that lacks it, and the poses of the first in an order by
chance, reached without a last move. The true arm is MuJoCo's (``studies.research.withheld.truth``) in
refits and in days that are diagnosed; its error follows formulas written here.

expected: standard deviations of the error's parameters, RMS over those of the plan by chance
refits: how ``calib.identify`` scatters about the truth on the planned day, chi-square over its degrees
    of freedom, one where the promise holds
found: share of the error's places that ``calib.diagnose`` names, first or in a class, where the model
    lacks it; its parameters are about six times the planned day's standard deviation
as good: poses of a plan that tells as much as thirty of the plan without the error

``repeatability`` is of the arm as a whole: at each visit the tip is off anew, so no order tells more of
it than another in which the arm leaves a pose before it comes again. The planned day visits four of 26
poses twice, today's visits thirty once. Its refits compare the logarithm of what ``calib.identify``
finds, RMS of translation and rotation over the true ones, with its standard deviation as second visits
alone would have it; found: share of days on which it finds any.

``--real`` asks what another order would have told on real days, under POSECAL_DATA: standard deviations
of the same poses in an order by chance, and from sides by chance, over those of the order as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import click
import numpy as np

import calib
import doe
from calib import Cell
from calib.arrays import Array, Mask
from calib.cell import Repeatability
from calib.model import Model
from calib.model.build import build
from calib.poses import Measurements, Poses, poses_at
from calib.poses.moves import with_moves
from calib.uncertainty.pose_to_pose import pose_to_pose
from doe import Design
from doe.day.day import day_of
from doe.problem.linearisation import nominal
from studies.research.bench import (
    Output,
    Row,
    bench,
    cell_from,
    count,
    each,
    real_data,
    rms,
    several,
    table,
)
from studies.research.benchmarks.day import SIGMA, cell_text, placement, reflectors, standing
from studies.research.withheld.robots import LIGHT
from studies.research.withheld.scene import Scatter
from studies.research.withheld.truth import Mechanism, urdf

_POSES, _FEWER = 30, (12, 16, 20, 24)
_CANDIDATES = 4000
_SPEEDS = "[robot.speed_deg_s]\n" + "".join(f"{name} = 120\n" for name in LIGHT.names)
_TAU = 1800.0  # s, of the warm-up
_SIZE = 6.0  # standard deviations of the planned day
_REAL, _READ, _PACE = ("irb120_faro", "ur10_leica_b"), 300, 12.0  # readings, and s between them
_OPEN = 1e-9  # of the largest singular value

Errors = tuple[Array, Array]
"""Of each reading: what joints are off by (m, n), and how far the base moved (m, 6)."""


@dataclass(frozen=True)
class Case:
    """An error that depends on the order.

    effect : as the model names it; reading : s, that a reading takes
    errors : (poses, parameters in SI) -> what they make of each reading
    """

    effect: str
    reading: float
    errors: Callable[[Poses, Array], Errors]


def _lost(poses: Poses, values: Array) -> Errors:
    return _approach(poses) * values, np.zeros((len(poses), 6))


def _settling(poses: Poses, values: Array) -> Errors:
    move = np.zeros_like(poses.q) if poses.motion is None else poses.motion
    share = move / np.maximum(move.max(axis=1, keepdims=True), 1e-12)
    each_joint = values.reshape(-1, 2).T
    left = -_approach(poses) * (each_joint[0] * move + each_joint[1] * share)
    return left, np.zeros((len(poses), 6))


def _drift(poses: Poses, values: Array) -> Errors:
    return np.zeros_like(poses.q), poses.elapsed[:, None] * values


def _warming(poses: Poses, values: Array) -> Errors:
    return np.zeros_like(poses.q), np.exp(-poses.elapsed / _TAU)[:, None] * values[1:]


def _approach(poses: Poses) -> Array:
    return np.zeros_like(poses.q) if poses.approach is None else poses.approach


CASES = {
    "backlash": Case("backlash", 10.0, _lost),
    "settling": Case("settling", 10.0, _settling),
    "base_drift": Case("base_drift", 100.0, _drift),
    "warm_up": Case("warm_up:base", 200.0, _warming),
}
DAYS = ("planned", "today's", "by chance")
_AGAIN, _TWICE = "repeatability", 4
_TIP = Repeatability(100e-6, 1e-3)  # m and rad, how the tip comes back: well above the noise


def cell_for(case: Case, model: bool) -> Cell:
    """The cell of a day; model : whether its model has the error."""
    guesses = reflectors(np.random.default_rng(0), LIGHT)
    text = cell_text("a day", LIGHT, guesses, SIGMA)
    if model:
        text = text.replace('"geometry"]', f'"geometry", "{case.effect}"]')
    text += f"{_SPEEDS}[timing]\nread_s = {case.reading}\n"
    return cell_from(text, urdf(LIGHT, masses=False))


@cache
def plan_of(name: str, model: bool, poses: int = _POSES) -> Poses:
    """The plan of a cell, in its order and with its times."""
    plan = doe.design(
        cell_for(CASES[name], model),
        poses=poses, criterion="D", candidates=_CANDIDATES, reapproach=0,
    )  # fmt: skip
    return plan.poses if plan.poses.approach is not None else with_moves(plan.poses)


def by_chance(name: str, seed: int) -> Poses:
    """The planned poses in another order, each reached straight from the one before."""
    cell, q = cell_for(CASES[name], True), plan_of(name, True).q
    q = q[np.random.default_rng([seed, 1]).permutation(len(q))]
    return with_moves(day_of(cell, poses_at(q)).timed)


def days_of(name: str, seed: int) -> dict[str, Poses]:
    """The three days."""
    return dict(
        zip(DAYS, (plan_of(name, True), plan_of(name, False), by_chance(name, seed)), strict=True)
    )


def expected(name: str, poses: Poses) -> Array:
    """Standard deviations of the error's parameters, SI, in a model that has it; inf if open."""
    model, own = _modelled(name, poses)
    return _deviations(model, poses, SIGMA)[own]


def _deviations(model: Model, poses: Poses, sigma: float) -> Array:
    """Standard deviations of all parameters, SI, by readings of one noise; inf where one is open."""
    _, J = model.jacobian(nominal(model, poses), poses)
    rows = J.reshape(-1, J.shape[-1]) / sigma
    scale = np.linalg.norm(rows, axis=0)
    _, s, V = np.linalg.svd(rows / scale, full_matrices=False)
    std = np.linalg.norm(V / s[:, None], axis=0) / scale
    return np.asarray(np.where(s[-1] > _OPEN * s[0], std, np.inf))


def _modelled(name: str, poses: Poses) -> tuple[Model, Mask]:
    """The model that has the error, and which of its parameters are the error's."""
    model = build(cell_for(CASES[name], True), poses).model
    kind = CASES[name].effect.partition(":")[0]
    return model, np.array([p.effect == kind for p in model.parameters])


def truth_of(name: str, rng: np.random.Generator) -> Array:
    """The error of a day, its parameters in SI; a warm-up's time constant is the first."""
    size = _SIZE * expected(name, plan_of(name, True))
    values = np.asarray(rng.normal(size=len(size)) * size)
    if name == "warm_up":
        values[0] = _TAU
    return values


def read(
    name: str,
    poses: Poses,
    values: Array,
    rng: np.random.Generator,
    scatter: Scatter | None = None,
) -> Measurements:
    """What the tracker reads on a day of the true arm, which scatters from visit to visit."""
    off, moved = CASES[name].errors(poses, values)
    geometry = rng.normal(size=(LIGHT.dof + 2, 6)) * np.repeat([3e-4, 4e-4], 3)
    markers = reflectors(np.random.default_rng(0), LIGHT) + rng.normal(size=(3, 3)) * 1e-3
    mechanism = Mechanism(LIGHT, geometry, markers, weighs=False)
    state = standing(mechanism, poses.q + off, *placement(rng), scatter, rng, moved=moved)
    points = state.readings
    points = points + rng.normal(size=points.shape) * SIGMA
    seen = np.ones(points.shape[:2], dtype=bool)
    return Measurements(poses, points, seen, np.full(seen.shape, np.nan))


def refit(name: str, day: str, seed: int) -> list[float]:
    """Errors of the parameters of one day as identified, in expected standard deviations."""
    rng, poses = np.random.default_rng([seed, 2]), days_of(name, seed)[day]
    values = truth_of(name, rng)
    cell = cell_for(CASES[name], True)
    found = calib.identify(cell, read(name, poses, values, rng))
    own = np.array([p.effect == cell.effects[-1].partition(":")[0] for p in found.model.parameters])
    return list((found.values[own] - values) / np.sqrt(np.diag(found.covariance)[own]))


def told(name: str, day: str, seed: int) -> tuple[float, float]:
    """Shares of the error's places that the diagnosis of a day names: among others, and first."""
    rng, poses = np.random.default_rng([seed, 3]), days_of(name, seed)[day]
    values = truth_of(name, rng)
    cell, kind = cell_for(CASES[name], False), CASES[name].effect.partition(":")[0]
    found = calib.diagnose(cell, read(name, poses, values, rng))
    named = {(own.name, own.where) for own in found.causes}
    alike = {(c.effect.kind, c.where) for own in found.causes for c, _ in own.members}
    places = LIGHT.names if kind in ("backlash", "settling") else ("base",)
    among, first = (np.mean([(kind, where) in own for where in places]) for own in (alike, named))
    return float(among), float(first)


@bench(
    count("--refits", 40, least=0),
    several("--only", [*CASES, _AGAIN]),
    click.option("--real", is_flag=True, help="Real days instead: what another order had told."),
    days=50,
    days_help="Simulated days that are diagnosed, in either order.",
    workers=True,
)
def main(
    refits: int, only: tuple[str, ...], real: bool, days: int, workers: int, seed: int
) -> Output:
    """Compare planned orders with orders by chance."""
    if real:
        rows = [
            _real(name, effect, seed) for name in _REAL for effect in ("backlash", "base_drift")
        ]
        return [table(rows)], rows
    rows = [
        _again(day, days, workers, seed)
        if name == _AGAIN
        else _measured(name, day, refits, days, workers, seed)
        for name in only
        for day in DAYS
    ]
    return [table(rows)], rows


@cache
def _twice() -> Design:
    """Four of 26 poses visited twice."""
    return doe.design(
        cell_for(CASES["backlash"], False),
        poses=_POSES - _TWICE, criterion="D", candidates=_CANDIDATES, reapproach=_TWICE,
    )  # fmt: skip


def found_again(day: str, seed: int) -> float | None:
    """The repeatability that one day shows over the true one; None where it shows none."""
    rng, cell = np.random.default_rng([seed, 4]), cell_for(CASES["backlash"], False)
    poses = plan_of("backlash", False) if day == DAYS[1] else with_moves(_twice().poses)
    if day == DAYS[2]:
        poses = with_moves(day_of(cell, poses_at(_left_between(rng, poses.q))).timed)
    tip = np.repeat([_TIP.translation, _TIP.rotation], 3)
    data = read("backlash", poses, np.zeros(LIGHT.dof), rng, Scatter(np.zeros(LIGHT.dof), tip))
    found = calib.identify(cell, data)
    arm = pose_to_pose(found.levels, found.scatter, cell.robot.reach).arm
    if arm is None or arm == Repeatability(0.0, 0.0):
        return None
    return rms(np.array([arm.translation / _TIP.translation, arm.rotation / _TIP.rotation]))


def _left_between(rng: np.random.Generator, q: Array) -> Array:
    """Poses (m, n) in an order by chance in which none follows itself."""
    mixed = rng.permutation(q)
    return mixed if np.diff(mixed, axis=0).any(axis=1).all() else _left_between(rng, q)


def _again(day: str, days: int, workers: int, seed: int) -> Row:
    """A line: what one kind of day tells of the repeatability."""
    found = each(found_again, [(day, seed + 1 + k) for k in range(days)], workers)
    told, plan = [own for own in found if own is not None], _twice()
    expected = np.nan if plan.reapproaches is None else plan.reapproaches.common
    poses = plan_of("backlash", False) if day == DAYS[1] else plan.poses
    return {
        "error": _AGAIN, "day": day, "minutes": float(poses.elapsed[-1]) / 60.0,
        "expected": None if day == DAYS[1] else 1.0,
        "refits": rms(np.log(told) / expected) ** 2 if told else None,
        "found": len(told) / days if days else None, "named first": None, "as good": None,
    }  # fmt: skip


def _real(name: str, effect: str, seed: int) -> Row:
    """A real day: what an error's deviations were, and by how much another order had changed them."""
    cell, data = real_data(name)
    rng, q = np.random.default_rng(seed), data.poses.q[:_READ]
    time = np.arange(len(q)) * _PACE
    was = with_moves(poses_at(q, time=time))
    mixed = with_moves(poses_at(rng.permutation(q), time=time))
    sides = replace(was, approach=rng.choice([-1.0, 1.0], q.shape), approach_derived=False)
    cell = replace(cell, effects=(*cell.effects, effect))

    def told(poses: Poses) -> Array:
        model = build(cell, poses).model
        own = np.array([p.effect == effect for p in model.parameters])
        return np.asarray(_deviations(model, poses, model.readout.even or SIGMA)[own])

    before = told(was)
    return {
        "data": name, "poses": len(q), "error": effect, "as it was [1e-6]": rms(before * 1e6),
        "by chance": rms(told(mixed) / before), "sides by chance": rms(told(sides) / before),
    }  # fmt: skip


def _measured(name: str, day: str, refits: int, days: int, workers: int, seed: int) -> Row:
    """A line: one kind of day with one error."""
    orders, planned = days_of(name, seed), day == DAYS[0]
    chance = expected(name, orders["by chance"])

    def ratio(poses: Poses) -> float:
        own = expected(name, poses) / chance
        return rms(own[np.isfinite(chance)])

    enough = ratio(orders[DAYS[1]])
    fewer = (n for n in _FEWER if planned and ratio(plan_of(name, True, n)) <= enough)
    z = each(refit, [(name, day, seed + 1 + k) for k in range(refits * planned)], workers)
    found = each(told, [(name, day, seed + 1 + k) for k in range(days)], workers)
    among, first = np.mean(found, axis=0) if found else (None, None)
    return {
        "error": name, "day": day, "minutes": float(orders[day].elapsed[-1]) / 60.0,
        "expected": ratio(orders[day]), "refits": rms(np.array(z)) ** 2 if z else None,
        "found": among, "named first": first,
        "as good": next(fewer, _POSES) if planned else None,
    }  # fmt: skip


if __name__ == "__main__":
    main()
