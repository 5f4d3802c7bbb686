"""Days that plan themselves by ``posecal next``, against a fixed plan of the same length.

    python -m studies.research.benchmarks.next_poses [--days 20] [--causes 6] [--seed 0] [--json FILE]

The KR 270 of the demonstration, three markers read to 0.01 mm, a robot off by plausible errors. A day
begins with six random poses; then two at a time are chosen from what was read, up to twenty. Beside it,
on the same robot: twenty random poses, and the plan that ``posecal design`` makes for the task, in its
order. The error is the expected one at the targets, by the poses and the true robot; poses are saved
where the day is where the fixed plan ends. Where a fixed plan ends better than the day, none are.

``--causes``: the arm has a cause that its model lacks and that another looks like. Poses are counted
until a diagnosis names it alone: chosen for the rivals by turns of four, or taken from random poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import numpy as np

import doe
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.diagnose import diagnose
from calib.effects.protocol import Effect
from calib.files.write import json_text, write_files
from calib.model import Model
from calib.model.build import build, context_of, place_effect
from calib.model.covariance import accuracy, covariance
from calib.poses import Poses, poses_at
from calib.simulation import simulate
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.research.benchmarks.changes import arms
from studies.tables import plain_table

START, STEP, LENGTH = 6, 2, 20
CAUSES = (("transmission_scale", "A3"), ("transmission_scale", "A2"), ("joint_coupling", "A3"))
_START_CAUSES, _STEP_CAUSES, _LENGTH_CAUSES = 12, 4, 32
_SHOWN = 8.0  # standard deviations by which the starting poses show a cause
_HEADINGS = (
    ("against", "left"), ("days", "right"), ("error of the day", "right"),
    ("of the plan [mm]", "right"), ("poses saved", "right"), ("of", "right"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot, and the cell that it is measured in."""

    cell: Cell
    model: Model
    truth: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Robot:
        cell = arms()[0]
        model = build(cell).model
        truth = 0.3 * rng.normal(size=len(model.sizes)) * model.sizes
        truth[[p.effect == "base" for p in model.parameters]] = [3.0, 1.0, 0.5, 0.1, 0.3, -0.4]
        return cls(cell, model, truth)

    def random(self, count: int, rng: np.random.Generator) -> Array:
        """Joint values within the limits, (count, dof)."""
        low, high = self.cell.robot.sample_limits().T
        return rng.uniform(low, high, (count, len(low)))

    def expected(self, q: Array) -> float:
        """RMS error at the targets that these poses leave, m."""
        _, J = self.model.jacobian(self.truth, poses_at(q))
        rows = J.reshape(-1, J.shape[-1]) / self.cell.noise.along
        cov = covariance(rows, np.eye(len(self.truth)))
        return accuracy(self.model, self.truth, cov, *targets_of(self.cell))[0]


def named(q: Array) -> Poses:
    """Poses at joint values, (m, dof)."""
    return poses_at(q, names=[f"p{i}" for i in range(len(q))])


@dataclass(frozen=True)
class Day:
    """Expected errors after 6, 8 .. poses of the day, and of each plan at its end, m."""

    errors: tuple[float, ...]
    plans: dict[str, float]

    def saved(self, plan: str) -> int:
        """Poses by which the day is sooner where the plan ends."""
        reached = [k for k, error in enumerate(self.errors) if error <= self.plans[plan]]
        return LENGTH - START - STEP * reached[0] if reached else 0


def day(rng: np.random.Generator) -> Day:
    """A day that chooses its poses for the task, and fixed plans beside it."""
    robot = Robot.drawn(rng)
    q = robot.random(START, rng)
    data = simulate(robot.model, robot.truth, named(q), robot.cell.noise, rng)
    errors = [robot.expected(q)]
    while len(q) < LENGTH:
        further = doe.onward(robot.cell, data, count=STEP, goal=1e-9).poses.q
        if not len(further):  # beyond reach, for what the readings show: the last word is the fit's
            further = robot.random(STEP, rng)
        q = np.concatenate([q, further])
        fresh = simulate(robot.model, robot.truth, named(q), robot.cell.noise, rng)
        own = np.concatenate([data.readings, fresh.readings[len(data) :]])
        data = replace(fresh, readings=own)
        errors.append(robot.expected(q))
    fixed = doe.design(robot.cell, poses=LENGTH, candidates=2000, fresh=False, levels=None)
    plans = {"random poses": robot.random(LENGTH, rng), "posecal design": fixed.poses.q}
    return Day(tuple(errors), {name: robot.expected(own) for name, own in plans.items()})


@dataclass(frozen=True)
class Found:
    """Poses until a cause was named alone: chosen, and random; None where it was not."""

    cause: str
    chosen: int | None
    random: int | None


def found(kind: str, where: str, rng: np.random.Generator) -> Found:
    """A day until its cause is named, by chosen poses and by random ones."""
    robot = Robot.drawn(rng)
    effect = place_effect(kind, where, context_of(robot.cell, named(robot.random(20, rng))))
    whole, values = robot.model.extended(robot.truth, (effect,))
    start = robot.random(_START_CAUSES, rng)
    own = _size(robot, whole, values, effect, start, rng)
    values = np.concatenate([robot.truth, own])

    def chosen(q: Array, cell: Cell) -> Array:
        data = simulate(whole, values, named(q), cell.noise, np.random.default_rng(len(q)))
        further = doe.onward(cell, data, aim="causes", count=_STEP_CAUSES).poses.q
        return further if len(further) else robot.random(_STEP_CAUSES, rng)

    ways: tuple[Callable[[Array, Cell], Array], ...] = (
        chosen,
        lambda _, __: robot.random(_STEP_CAUSES, rng),
    )
    needed = [_until_named(robot, whole, values, (kind, where), start, way) for way in ways]
    return Found(f"{kind}:{where}", *needed)


def _size(
    robot: Robot, whole: Model, values: Array, effect: Effect, q: Array, rng: np.random.Generator
) -> Array:
    """Values of a cause that the starting poses show by so many standard deviations."""
    _, J = whole.jacobian(values, named(q))
    J = J.reshape(-1, J.shape[-1]) / robot.cell.noise.along
    own = len(robot.truth)
    Q, _ = np.linalg.qr(J[:, :own])
    drawn = rng.normal(size=len(effect.parameters)) * [p.size for p in effect.parameters]
    seen = J[:, own:] @ drawn
    return np.asarray(drawn * _SHOWN / np.linalg.norm(seen - Q @ (Q.T @ seen)))


def _until_named(
    robot: Robot, whole: Model, values: Array, cause: tuple[str, str], q: Array,
    way: Callable[[Array, Cell], Array],
) -> int | None:  # fmt: skip
    while len(q) <= _LENGTH_CAUSES:
        data = simulate(whole, values, named(q), robot.cell.noise, np.random.default_rng(len(q)))
        seen = diagnose(robot.cell, data)
        causes = [c.named for c in seen.causes]
        if seen.verdict == "explained" and [
            (c.candidate.effect.kind, c.candidate.where) for c in causes
        ] == [cause]:
            return len(q)
        q = np.concatenate([q, way(q, robot.cell)])
    return None


def _rows(days: list[Day]) -> Iterator[tuple[str, ...]]:
    for plan in days[0].plans if days else ():
        end = float(np.median([own.errors[-1] for own in days])) * 1e3
        other = float(np.median([own.plans[plan] for own in days])) * 1e3
        saved = float(np.median([own.saved(plan) for own in days]))
        yield plan, str(len(days)), f"{end:.4f}", f"{other:.4f}", f"{saved:g}", str(LENGTH)


def _middle(counts: list[int | None]) -> str:
    middle = float(np.median([np.inf if n is None else n for n in counts]))
    return f"{middle:g}" if np.isfinite(middle) else f"> {_LENGTH_CAUSES}"


@click.command()
@click.option("--days", default=20, show_default=True, help="For the task.")
@click.option("--causes", default=6, show_default=True, help="Days with a cause.")
@click.option("--seed", default=0, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Every day.")
@one_line_faults
def main(days: int, causes: int, seed: int, json_path: Path | None) -> None:
    """Poses that a day saves which plans itself."""
    console = console_for(None)
    own = [day(np.random.default_rng([seed, k])) for k in range(days)]
    table = plain_table(*_HEADINGS)
    for row in _rows(own):
        table.add_row(*row)
    console.print(table)
    rivals = [
        found(*CAUSES[k % len(CAUSES)], np.random.default_rng([seed, 1, k])) for k in range(causes)
    ]
    if rivals:
        counts = [_middle([r.chosen for r in rivals]), _middle([r.random for r in rivals])]
        named_ = [
            sum(n is not None for n in of)
            for of in zip(*((r.chosen, r.random) for r in rivals), strict=True)
        ]
        console.print(
            f"causes named after {counts[0]} poses by posecal next, {counts[1]} at random "
            f"({named_[0]} and {named_[1]} of {len(rivals)} named within {_LENGTH_CAUSES})"
        )
    if json_path is not None:
        write_files({json_path: json_text([*map(asdict, own), *map(asdict, rivals)])})


if __name__ == "__main__":
    main()
