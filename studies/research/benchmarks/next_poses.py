"""Days that plan themselves by ``posecal next``, against a fixed plan of the same length.

    python -m studies.research.benchmarks.next_poses [--days 20] [--causes 6] [--first 0] [--seed 0]
        [--json FILE]

The KR 270 of the demonstration, three markers read to 0.01 mm, a robot off by plausible errors. Beside
the day, on the same robot: twenty random poses, and the plan that ``posecal design`` makes for the
task, in its order. The day begins with the first six poses of that plan; then two at a time are chosen
from what was read, up to twenty. The error is the expected one at the targets, by the poses that were
read and the true robot; poses are saved where the day is where the fixed plan ends. Where a fixed plan
ends better than the day, none are. On days ``all read`` every pose can be read; on days ``barred`` a
quarter of the joint box cannot, which nobody knows beforehand: who gets there has lost a pose.

``--causes``: the arm has a cause that its model lacks and that another looks like, of a size that
twelve random poses show by eight standard deviations. Poses are counted until a diagnosis names it
alone: chosen for the causes by turns of four, taken from the plan that is the best for the task beside
those twelve, or random. ``--first`` is the number of the first day.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np

import doe
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.diagnosis import Diagnosis
from calib.effects.protocol import Effect
from calib.files.write import json_text, write_files
from calib.model import Model
from calib.model.build import build, context_of, place_effect
from calib.model.covariance import accuracy, covariance
from calib.poses import Poses, poses_at
from calib.simulation import drawn_readings
from doe.ahead.next_poses import next_poses
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.research.benchmarks.changes import arms
from studies.tables import plain_table

START, STEP, LENGTH = 6, 2, 20
CAUSES = (("transmission_scale", "A3"), ("transmission_scale", "A2"), ("joint_coupling", "A3"))
_START_CAUSES, _STEP_CAUSES, _LENGTH_CAUSES = 12, 4, 32
_SHOWN = 8.0  # standard deviations by which the starting poses show a cause
_BARRED = 0.25  # of the joint box
_HEADINGS = (
    ("day", "left"), ("against", "left"), ("days", "right"), ("error of the day", "right"),
    ("of the plan [mm]", "right"), ("lost by the day", "right"), ("by the plan", "right"),
    ("poses saved", "right"), ("of", "right"),
)  # fmt: skip
_CAUSES = (
    ("poses", "left"), ("days", "right"), (f"named within {_LENGTH_CAUSES}", "right"),
    ("after", "right"),
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
        # Beside plausible sizes, known to a hundred times: what few poses leave open is finite.
        rows = np.concatenate([rows, np.diag(0.01 / self.model.sizes)])
        cov = covariance(rows, np.eye(len(self.truth)))
        return accuracy(self.model, self.truth, cov, *targets_of(self.cell))[0]

    def barred(self, rng: np.random.Generator) -> Callable[[Array], Mask]:
        """Which configurations (m, dof) cannot be read: a quarter of the joint box."""
        low, high = self.cell.robot.sample_limits().T
        across = rng.normal(size=len(low)) / (high - low)
        limit = np.quantile(self.random(10_000, rng) @ across, 1.0 - _BARRED)
        return lambda q: np.asarray(q @ across > limit)


def named(q: Array) -> Poses:
    """Poses at joint values, (m, dof)."""
    return poses_at(q, names=[f"p{i}" for i in range(len(q))])


@dataclass(frozen=True)
class Day:
    """Expected errors after 6, 8 .. poses of the day, and of each plan at its end, m.

    kind : what sort of day; lost : poses that could not be read, of the day and of each plan
    """

    kind: str
    errors: tuple[float, ...]
    plans: dict[str, float]
    lost: dict[str, int]

    def saved(self, plan: str) -> int:
        """Poses by which the day is sooner where the plan ends."""
        reached = [k for k, error in enumerate(self.errors) if error <= self.plans[plan]]
        return LENGTH - START - STEP * reached[0] if reached else 0


def day(rng: np.random.Generator, kind: str) -> Day:
    """A day that chooses its poses for the task, and fixed plans beside it."""
    robot = Robot.drawn(rng)
    barred = robot.barred(rng) if kind == "barred" else lambda q: np.zeros(len(q), dtype=bool)
    fixed = doe.design(
        robot.cell, poses=LENGTH, candidates=2000, fresh=False, levels=None, reapproach=0
    ).poses.q
    q = fixed[:START]
    errors = [robot.expected(q[~barred(q)])]
    seed = int(rng.integers(2**32))
    while len(q) < LENGTH:
        out = barred(q)
        data = drawn_readings(
            robot.model, robot.truth, named(q[~out]), robot.cell.noise, np.random.default_rng(seed)
        )
        found = doe.onward(
            robot.cell, data, count=STEP, goal=1e-9, ahead=LENGTH - len(q), missed=named(q[out])
        )
        # Beyond reach, for what the readings show: the last word is the fit's.
        further = found.poses.q if len(found.poses) else robot.random(STEP, rng)
        q = np.concatenate([q, further])
        errors.append(robot.expected(q[~barred(q)]))
    plans = {"random poses": robot.random(LENGTH, rng), "posecal design": fixed}
    lost = {name: int(barred(own).sum()) for name, own in {"day": q, **plans}.items()}
    ends = {name: robot.expected(own[~barred(own)]) for name, own in plans.items()}
    return Day(kind, tuple(errors), ends, lost)


@dataclass(frozen=True)
class Found:
    """Poses until a cause was named alone; None where it was not."""

    cause: str
    chosen: int | None
    planned: int | None
    random: int | None


def found(kind: str, where: str, rng: np.random.Generator) -> Found:
    """A day until its cause is named: by chosen poses, by those of a plan, and by random ones."""
    robot = Robot.drawn(rng)
    effect = place_effect(kind, where, context_of(robot.cell, named(robot.random(20, rng))))
    whole, values = robot.model.extended(robot.truth, (effect,))
    start = robot.random(_START_CAUSES, rng)
    own = _size(robot, whole, values, effect, start, rng)
    values = np.concatenate([robot.truth, own])
    length = _LENGTH_CAUSES - _START_CAUSES
    plan = doe.design(
        robot.cell,
        poses=length,
        extend=named(start),
        candidates=2000,
        fresh=False,
        levels=None,
        reapproach=0,
    ).poses.q[rng.permutation(length)]

    def chosen(_: Array, seen: Diagnosis) -> Array:
        further = next_poses(robot.cell, seen, count=_STEP_CAUSES, forms=True).poses.q
        return further if len(further) else robot.random(_STEP_CAUSES, rng)

    def planned(q: Array, _: Diagnosis) -> Array:
        return plan[len(q) - _START_CAUSES :][:_STEP_CAUSES]

    def anywhere(_: Array, __: Diagnosis) -> Array:
        return robot.random(_STEP_CAUSES, rng)

    needed = [
        _until_named(robot, whole, values, (kind, where), start, way)
        for way in (chosen, planned, anywhere)
    ]
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
    way: Callable[[Array, Diagnosis], Array],
) -> int | None:  # fmt: skip
    while True:
        data = drawn_readings(
            whole, values, named(q), robot.cell.noise, np.random.default_rng(len(q))
        )
        seen = diagnose(robot.cell, data)
        causes = [(c.named.candidate.effect.kind, c.named.candidate.where) for c in seen.causes]
        if seen.verdict == "explained" and causes == [cause]:
            return len(q)
        if len(q) >= _LENGTH_CAUSES:
            return None
        q = np.concatenate([q, way(q, seen)])


def _rows(days: list[Day]) -> Iterator[tuple[str, ...]]:
    for kind in dict.fromkeys(own.kind for own in days):
        these = [own for own in days if own.kind == kind]
        end = float(np.median([own.errors[-1] for own in these])) * 1e3
        for plan in these[0].plans:
            other = float(np.median([own.plans[plan] for own in these])) * 1e3
            saved = float(np.median([own.saved(plan) for own in these]))
            lost = [float(np.median([own.lost[name] for own in these])) for name in ("day", plan)]
            yield (
                kind, plan, str(len(these)), f"{end:.4f}", f"{other:.4f}",
                f"{lost[0]:g}", f"{lost[1]:g}", f"{saved:g}", str(LENGTH),
            )  # fmt: skip


def _middle(counts: list[int | None]) -> str:
    middle = float(np.median([np.inf if n is None else n for n in counts]))
    return f"{middle:g}" if np.isfinite(middle) else f"> {_LENGTH_CAUSES}"


def _told(rivals: list[Found]) -> Iterator[tuple[str, ...]]:
    for way in ("chosen", "planned", "random"):
        counts = [getattr(own, way) for own in rivals]
        within = sum(n is not None for n in counts)
        yield way, str(len(rivals)), str(within), _middle(counts)


@click.command()
@click.option("--days", default=20, show_default=True, help="For the task, of each kind.")
@click.option("--causes", default=6, show_default=True, help="Days with a cause.")
@click.option("--first", default=0, show_default=True, help="Number of the first day.")
@click.option("--seed", default=0, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Every day.")
@one_line_faults
def main(days: int, causes: int, first: int, seed: int, json_path: Path | None) -> None:
    """Poses that a day saves which plans itself."""
    console = console_for(None)
    own = [
        day(np.random.default_rng([seed, k]), kind)
        for kind in ("all read", "barred")
        for k in range(first, first + days)
    ]
    rivals = [
        found(*CAUSES[k % len(CAUSES)], np.random.default_rng([seed, 1, k]))
        for k in range(first, first + causes)
    ]
    for headings, rows in ((_HEADINGS, _rows(own)), (_CAUSES, _told(rivals))):
        table = plain_table(*headings)
        for row in rows:
            table.add_row(*row)
        console.print(table)
    if json_path is not None:
        write_files({json_path: json_text([*map(asdict, own), *map(asdict, rivals)])})


if __name__ == "__main__":
    main()
