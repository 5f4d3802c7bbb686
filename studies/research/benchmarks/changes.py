"""How often ``posecal changes`` raises a false alarm, and how often it names what changed.

    python -m studies.research.benchmarks.changes [--pairs 500] [--identified 60] [--seed 0]
        [--json FILE]

A pair is two days of one robot, each at random poses of its own: the KR 270 of the demonstration and a
chain of seven joints with nothing special, three markers; base, tool and geometry identified. On half
of the pairs the instrument is put elsewhere between the days. Half change in nothing; on the others a
single cause of a size that its noncentrality (squared shift in standard deviations, over all that is
compared) is drawn from 60 to 400. Pairs are drawn to first order, estimates normal about what least
squares makes of the truth; ``--identified`` of them besides are simulated in full and go through
``calib.identify`` twice, half of those with an arm that scatters by 0.02 mm and 0.02 mrad.

Its noncentrality is taken by the covariances that the pair itself has: a change that the model lacks
also makes the later fit worse, and where the noise is found from what the fit leaves, the less sure.
Changes that end below 60 stand apart; "fit worse" counts what is said of that.

``exact`` counts causes named first, ``class`` those named first or as one that can do the same or is
worth naming beside it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import calib
from calib.arm.robot import Robot
from calib.arm.se3 import so3_exp, transform
from calib.arrays import Array
from calib.cell import Cell, Repeatability
from calib.cell.planned import Planned
from calib.change import Changes, DayEstimate, changes, known_of
from calib.change.causes import ChangeCause, candidates
from calib.change.difference import difference
from calib.compensation.estimate import Estimate, estimate_of
from calib.compensation.unexplained import Unexplained
from calib.effects import catalogue
from calib.effects.geometry import LinkGeometry
from calib.effects.protocol import Effect
from calib.model import Model
from calib.model.build import build, context_of
from calib.model.covariance import covariance
from calib.poses import Poses, poses_at
from calib.simulation import drawn_readings
from studies.demo.embedded import embedded_cell
from studies.research.bench import Output, Row, bench, count, each, table

POSES = 25
NONCENTRALITY = (60.0, 400.0)
# Standard deviations that a plausible size shifts: ten times that is the largest drawn.
VISIBLE = 2.0
SCATTER = Repeatability(2e-5, 2e-5)
PLACE = (3.0, 1.0, 0.5, 0.1, 0.3, -0.4)  # m and rad, of the base before the instrument
ELSEWHERE = (2.0, -1.5, 0.4, 0.2, -0.1, 0.9)


@dataclass(frozen=True, eq=False)
class Day:
    """What a day knows, as it is compared."""

    known: DayEstimate
    estimate: Estimate
    poses: Poses


def arms() -> tuple[Cell, Cell]:
    """The two robots, in cells with three markers and nothing but rigid parameters."""
    kr270 = replace(embedded_cell(), effects=("base", "tool", "geometry"), load=None, knots={})
    rng = np.random.default_rng(7)
    axes = rng.normal(size=(7, 3))
    turns, shifts = so3_exp(rng.normal(size=(8, 3))), rng.uniform(-0.4, 0.4, (8, 3))
    chain = Robot(
        name="chain",
        base="base",
        tip="tip",
        joints=tuple(f"j{k + 1}" for k in range(7)),
        prismatic=np.zeros(7, dtype=bool),
        origins=transform(turns, shifts),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        limits=np.tile([-2.5, 2.5], (7, 1)),
        efforts=np.full(7, np.nan),
        masses=np.zeros(7),
        coms=np.zeros((7, 3)),
    )
    return kr270, replace(kr270, robot=chain, name="chain", design=Planned())


def drawn_poses(cell: Cell, rng: np.random.Generator) -> Poses:
    """Random poses, each joint come to from either side."""
    low, high = cell.robot.sample_limits().T
    q = rng.uniform(low, high, (POSES, cell.robot.dof))
    return poses_at(q, approach=rng.choice([-1.0, 1.0], q.shape))


def drawn_truth(model: Model, rng: np.random.Generator, moved: bool) -> Array:
    """A robot off by plausible errors; ``moved``: with the instrument elsewhere."""
    truth = 0.3 * rng.normal(size=len(model.sizes)) * model.sizes
    truth[[p.effect == "base" for p in model.parameters]] = ELSEWHERE if moved else PLACE
    return truth


def linear_day(
    cell: Cell, model: Model, truth: Array, poses: Poses, rng: np.random.Generator,
    effect: Effect | None = None, size: Array | None = None,
) -> Day:  # fmt: skip
    """A day drawn to first order: its estimate is normal about what least squares finds."""
    whole, values = model.extended(truth, () if effect is None else (effect,))
    _, J = whole.jacobian(values, poses)
    J = J.reshape(-1, J.shape[-1]) / cell.noise.along
    own = len(truth)
    cov = covariance(J[:, :own], np.eye(own))
    estimate = truth + np.linalg.cholesky(cov) @ rng.standard_normal(own)
    if size is not None:
        estimate = estimate + cov @ J[:, :own].T @ (J[:, own:] @ size)
    markers = dict(zip(model.marker_names, model.marker_positions(estimate), strict=True))
    keys = model.keys
    known = DayEstimate(
        keys, estimate, cov, np.zeros(own, dtype=bool), markers, np.inf, poses=poses
    )
    rest = Unexplained(0.0, "")
    return Day(known, Estimate(model, estimate, cov, 0.0, rest, ()), poses)


def full_day(
    cell: Cell, model: Model, truth: Array, poses: Poses, rng: np.random.Generator,
    effect: Effect | None = None, size: Array | None = None, arm: Repeatability | None = None,
) -> Day:  # fmt: skip
    """A day simulated in full and identified."""
    whole, values = model.extended(truth, () if effect is None else (effect,))
    values = values if size is None else np.concatenate([truth, size])
    data = drawn_readings(whole, values, poses, cell.noise, rng, arm=arm)
    found = calib.identify(cell, data)
    return Day(known_of(found), estimate_of(found), data.poses)


def compare(cell: Cell, before: Day, after: Day) -> Changes:
    """What ``posecal changes`` finds."""
    return changes(cell, before.known, after.known, after.estimate)


def effect_of(cell: Cell, cause: ChangeCause, poses: Poses) -> Effect:
    """The effect that a simulated change acts by."""
    robot, context = cell.robot, context_of(cell, poses)
    if cause.kind == "base":
        return LinkGeometry(robot.base, 0)
    if cause.kind == "tool":
        return LinkGeometry(robot.tip, robot.tip_frame)
    return catalogue()[cause.kind].at(context, cause.where)


def drawn_change(
    before: Day, after: Day, cell: Cell, rng: np.random.Generator
) -> tuple[ChangeCause, Array]:
    """A cause and its size, by what the pair would show of it."""
    found = difference(before.known, after.known)
    estimate = after.estimate
    asked = [
        cause
        for cause in candidates(
            found, estimate.model, estimate.values, after.poses, context_of(cell, after.poses)
        )
        if np.linalg.norm(found.half @ (cause.columns * cause.sizes)) > VISIBLE
    ]
    kinds = sorted({cause.kind for cause in asked})
    kind = kinds[int(rng.integers(len(kinds)))]
    own = [cause for cause in asked if cause.kind == kind]
    cause = own[int(rng.integers(len(own)))]
    size = rng.normal(size=len(cause.sizes)) * cause.sizes
    shown = float(((found.half @ cause.columns @ size) ** 2).sum())
    wanted = rng.uniform(1.2 * NONCENTRALITY[0], NONCENTRALITY[1])
    return cause, size * np.sqrt(wanted / max(shown, 1e-12))


def pair(cell: Cell, seed: int, full: bool) -> dict[str, Any]:
    """One pair: what changed, and what was said of it."""
    rng = np.random.default_rng(seed)
    moved, changed = bool(rng.integers(2)), bool(seed % 2)
    arm = SCATTER if full and rng.integers(2) else None
    model = build(cell).model
    truth = drawn_truth(model, rng, False)
    later = truth.copy()
    base = np.array([p.effect == "base" for p in model.parameters])
    later[base] = drawn_truth(model, rng, moved)[base]
    first, second = drawn_poses(cell, rng), drawn_poses(cell, rng)
    options: dict[str, Any] = {"arm": arm} if full else {}
    day = full_day if full else linear_day
    before = day(cell, model, truth, first, rng, **options)
    cause, size = None, None
    if changed:
        # A marker's own effect stands in the model; it moves by its parameters.
        plain = day(cell, model, later, second, rng, **options)
        cause, size = drawn_change(before, plain, cell, rng)
        if cause.kind == "marker":
            own = [
                p.effect == "tool" and p.where == f"marker:{cause.where}" for p in model.parameters
            ]
            later[own] += size
        else:
            options |= {"effect": effect_of(cell, cause, second), "size": size}
    after = day(cell, model, later, second, rng, **options)
    found = compare(cell, before, after)
    D = found.difference
    shown = (
        None if cause is None else float(((D.half @ cause.columns @ np.asarray(size)) ** 2).sum())
    )
    return {"full": full, "noncentrality": shown,
            "scatters": arm is not None, "elsewhere": moved, **_told(found, cause)}  # fmt: skip


def _told(found: Changes, cause: ChangeCause | None) -> dict[str, Any]:
    first = found.cause
    named = [] if first is None else [first.cause, *found.same_as]
    named += [e.cause for e in found.explanations if first is not None and e.likely]
    keys = [(c.kind, c.where) for c in named]
    true = None if cause is None else (cause.kind, cause.where)
    return {
        "cause": None if true is None else ":".join(true),
        "grown": found.difference.leaves_more,
        "moved": found.difference.changed,
        "told": found.told,
        "named": None if first is None else f"{first.cause.kind}:{first.cause.where}",
        "exact": true is not None and keys[:1] == [true],
        "class": true in keys,
    }


def rows(pairs: list[Row]) -> Iterator[Row]:
    """One row for all pairs of a kind, and one for each cause."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for one in pairs:
        groups["drawn to first order" if not one["full"] else
               f"identified{', arm scatters' * one['scatters']}"].append(one)  # fmt: skip
        if one["cause"]:
            groups[f"  {one['cause'].partition(':')[0]}"].append(one)
    for name, own in groups.items():
        still = [one for one in own if one["cause"] is None]
        every = [one for one in own if one["cause"] is not None]
        changed = [one for one in every if one["noncentrality"] >= NONCENTRALITY[0]]
        below = [one for one in every if one not in changed]
        yield {
            "pairs": name,
            "no change": len(still),
            "alarms": _share(still, "moved"),
            "changes": len(changed),
            "seen": _share(changed, "moved"),
            "exact": _share(changed, "exact"),
            "class": _share(changed, "class"),
            "below 60": str(len(below) or ""),
            "below 60, seen": _share(below, "moved"),
            "fit worse: no change": _share(still, "grown"),
            "change": _share(every, "grown"),
        }


def _share(pairs: list[Row], key: str) -> str:
    return f"{100.0 * np.mean([one[key] for one in pairs]):.1f} %" if pairs else ""


@bench(
    count("--pairs", 500, least=0, help="Drawn to first order."),
    count("--identified", 60, least=0, help="Pairs identified in full."),
    workers=True,
)
def main(pairs: int, identified: int, seed: int, workers: int) -> Output:
    """False alarms and named causes on simulated pairs of days."""
    cells = arms()
    tasks = [(cells[k // 2 % 2], 100_000 * seed + k, k >= pairs) for k in range(pairs + identified)]
    found = each(pair, tasks, workers)
    return [table(rows(found))], found


if __name__ == "__main__":
    main()
