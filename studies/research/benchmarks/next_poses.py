"""Days that plan themselves by ``posecal next``, against a fixed plan of the same length.

    python -m studies.research.benchmarks.next_poses [--days 20] [--causes 6] [--seed 0]
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
those twelve, or random.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np

import doe
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.effects.protocol import Effect
from calib.model import Model
from calib.model.build import build, context_of, place_effect
from calib.model.covariance import accuracy, covariance
from calib.poses import Poses, poses_at
from calib.simulation import drawn_readings
from doe.ahead.next_poses import next_poses
from studies.research.bench import Output, Row, bench, count, each, median_or_more, table
from studies.research.benchmarks.changes import arms, drawn_truth

START, STEP, LENGTH = 6, 2, 20
CAUSES = (("transmission_scale", "A3"), ("transmission_scale", "A2"), ("joint_coupling", "A3"))
_START_CAUSES, _STEP_CAUSES, _LENGTH_CAUSES = 12, 4, 32
_SHOWN = 8.0  # standard deviations by which the starting poses show a cause
_BARRED = 0.25  # of the joint box


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
        return cls(cell, model, drawn_truth(model, rng, moved=False))

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


def day(kind: str, index: int, seed: int) -> Day:
    """A day that chooses its poses for the task, and fixed plans beside it."""
    rng = np.random.default_rng([seed, index])
    robot = Robot.drawn(rng)
    barred = robot.barred(rng) if kind == "barred" else lambda q: np.zeros(len(q), dtype=bool)
    fixed = doe.design(robot.cell, poses=LENGTH, candidates=2000, levels=None, reapproach=0).poses.q
    q = fixed[:START]
    errors = [robot.expected(q[~barred(q)])]
    noise = int(rng.integers(2**32))
    while len(q) < LENGTH:
        out = barred(q)
        data = drawn_readings(
            robot.model, robot.truth, named(q[~out]), robot.cell.noise, np.random.default_rng(noise)
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


def found(kind: str, where: str, index: int, seed: int) -> Found:
    """A day until its cause is named: by chosen poses, by those of a plan, and by random ones."""
    rng = np.random.default_rng([seed, 1, index])
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


def _rows(days: list[Day]) -> Iterator[Row]:
    for kind in dict.fromkeys(own.kind for own in days):
        these = [own for own in days if own.kind == kind]
        for plan in these[0].plans:
            yield {
                "day": kind,
                "against": plan,
                "days": len(these),
                "error of the day": f"{1e3 * np.median([d.errors[-1] for d in these]):.4f}",
                "of the plan [mm]": f"{1e3 * np.median([d.plans[plan] for d in these]):.4f}",
                "lost by the day": f"{np.median([d.lost['day'] for d in these]):g}",
                "by the plan": f"{np.median([d.lost[plan] for d in these]):g}",
                "poses saved": f"{np.median([d.saved(plan) for d in these]):g}",
                "of": LENGTH,
            }


def _told(rivals: list[Found]) -> Iterator[Row]:
    for way in ("chosen", "planned", "random"):
        counts = [getattr(own, way) for own in rivals]
        yield {
            "poses": way,
            "days": len(rivals),
            f"named within {_LENGTH_CAUSES}": sum(n is not None for n in counts),
            "after": median_or_more(counts, _LENGTH_CAUSES),
        }


@bench(
    count("--causes", 6, least=0, help="Days with a cause."),
    count("--days", 20, least=0, help="For the task, of each kind."),
    workers=True,
)
def main(days: int, causes: int, seed: int, workers: int) -> Output:
    """Poses that a day saves which plans itself."""
    own = each(day, product(("all read", "barred"), range(days)), workers, seed=seed)
    drawn = ((*CAUSES[k % len(CAUSES)], k) for k in range(causes))
    rivals = each(found, drawn, workers, seed=seed)
    figures = [*map(asdict, own), *map(asdict, rivals)]
    return [table(_rows(own)), *([table(_told(rivals))] if rivals else ())], figures


if __name__ == "__main__":
    main()
