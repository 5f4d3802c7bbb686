"""Whole plans of random arms beside a plain exchange: what is lost to it, and in how much time.

    python -m studies.research.benchmarks.exchange [--problems 50] [--starts 60] [--json FILE]

An arm of four to seven joints with one to three markers, 6 to 42 parameters drawn from its base, its
links, its compliances and its markers, a pool of 500 to 2000 poses, and plans of 1.2 to 2.5 times the
poses that the count of rows asks for; criteria in turn. The plain exchange is what a user writes in a
day: from random plans each pose is tried against every candidate until none helps, by an update of low
rank in place of a fresh inverse, and the best plan is kicked and improved again. Both are timed in CPU
seconds, ours with the relaxation that its proof needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arrays import Array, IntArray
from doe.criteria import Criterion
from doe.criteria.determinant import Determinant
from doe.criteria.smallest import SmallestEigenvalue
from doe.criteria.trace import Average, Task
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from doe.problem import RIDGE
from studies.research.bench import Output, Row, bench, clocked, count, each, table

_CRITERIA = ("D", "A", "E", "task")
_JOINTS, _PARAMETERS, _POOL = (4, 7), (6, 42), (500, 2000)
_SPARE = (1.2, 2.5)  # poses over the least that could do
_KICKS = 30  # after the last start that the plain exchange makes from its best plan
_WORTH = 1e-7
_WORSE = 1e-3  # share by which a plan counts as worse
_SIZES = {"turn": 1e-3, "shift": 1e-3, "compliance": 1e-6}  # rad, m, rad/(N m)
_LOAD = np.array([0.0, 0.0, -1000.0])  # N at the tip


@dataclass(frozen=True, eq=False)
class Drawn:
    """A random problem.

    rows : ndarray, shape (n, r, p), of each candidate, the mean information about the identity
    targets : ndarray, shape (k, p), rows of the poses where the robot is to work
    V : ndarray, shape (p, p), parameters in plausible sizes
    """

    joints: int
    criterion: str
    poses: int
    rows: Array
    targets: Array
    V: Array

    @property
    def form(self) -> Criterion:
        """The criterion as ``posecal design`` would set it up."""
        if self.criterion == "task":
            return Task.of_rows(self.targets)
        if self.criterion == "E":
            return SmallestEigenvalue(self.V)
        return Determinant(self.V) if self.criterion == "D" else Average(self.V.T)


def draw(index: int, seed: int) -> Drawn:
    """Problem ``index`` of a seed."""
    rng = np.random.default_rng([seed, index])
    joints = int(rng.integers(_JOINTS[0], _JOINTS[1] + 1))
    markers, wanted = int(rng.integers(1, 4)), int(rng.integers(*_PARAMETERS, endpoint=True))
    arm = rng.normal(size=(joints + 1, 3)), rng.uniform(-0.5, 0.5, (joints + 1, 3))
    points = rng.uniform(-0.15, 0.15, (markers, 3))
    count, goals = int(rng.integers(*_POOL, endpoint=True)), int(rng.choice([1, 3, 20]))
    q = rng.uniform(-2.5, 2.5, (count + goals, joints))
    rows = _rows(*arm, points, q)
    rows = rows[..., _independent(rows, wanted, rng)]
    mean = np.einsum("nrp,nrq->pq", rows, rows) / len(rows)
    T = np.linalg.inv(np.linalg.cholesky(mean)).T
    turned = rows @ T
    p, r = rows.shape[2], int(np.linalg.matrix_rank(rows[:9], rtol=1e-9).max())
    poses = max(3, round(p / r * rng.uniform(*_SPARE)))
    name = _CRITERIA[index % len(_CRITERIA)]
    goal_rows = turned[count:].reshape(-1, p) / np.sqrt(goals * markers)
    return Drawn(joints, name, poses, turned[:count], goal_rows, T)


def _rows(turns: Array, shifts: Array, points: Array, q: Array) -> Array:
    """Markers' derivatives after small motions of every link's frame and the joints' compliances.

    q : ndarray, shape (n, joints), rad; returns shape (n, 3 markers, parameters)
    """
    R, at = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    frames = [(R, at)]
    for k, (turn, shift) in enumerate(zip(turns, shifts, strict=True)):
        at = at + R @ shift
        R = R @ Rotation.from_rotvec(turn).as_matrix()
        if k < q.shape[1]:
            about = np.zeros((len(q), 3))
            about[:, 2] = q[:, k]
            R = R @ Rotation.from_rotvec(about).as_matrix()
        frames.append((R, at))
    found = at[:, None] + points @ np.swapaxes(R, 1, 2)
    columns = []
    for k, (axes, origin) in enumerate(frames):
        arms = (found - origin[:, None])[:, None]  # (n, 1, markers, 3)
        along = np.swapaxes(axes, 1, 2)[:, :, None]  # (n, 3, 1, 3)
        turned = np.cross(along, arms)
        moved = np.broadcast_to(along, turned.shape)
        columns += [turned * _SIZES["turn"], moved * _SIZES["shift"]]
        if 0 < k < len(frames) - 1:
            torque = (axes[:, :, 2] * np.cross(at - origin, _LOAD)).sum(axis=1)
            columns.append(turned[:, 2:] * torque[:, None, None, None] * _SIZES["compliance"])
    stacked = np.concatenate(columns, axis=1)
    return np.asarray(stacked.transpose(0, 2, 3, 1).reshape(len(q), -1, stacked.shape[1]))


def _independent(rows: Array, wanted: int, rng: np.random.Generator) -> IntArray:
    """Parameters that the pool determines well, drawn in turn."""
    kept: list[int] = []
    flat = rows.reshape(-1, rows.shape[-1])
    flat = flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    basis = np.zeros((len(flat), 0))
    for column in rng.permutation(flat.shape[1]):
        left = flat[:, column] - basis @ (basis.T @ flat[:, column])
        size = float(np.linalg.norm(left))
        if size > 0.02 and len(kept) < wanted:
            kept.append(int(column))
            basis = np.column_stack([basis, left / size])
    return np.array(kept)


class Plain:
    """Exchange in plain NumPy: every candidate is tried in place of every pose."""

    def __init__(self, drawn: Drawn) -> None:
        self.rows, self.poses = drawn.rows, drawn.poses
        self.eye = RIDGE * np.eye(drawn.rows.shape[2])
        self.name, self.V = drawn.criterion, drawn.V
        form = drawn.form
        self.C = form.F @ form.F.T if isinstance(form, Task | Average) else drawn.V.T @ drawn.V

    def value(self, plan: IntArray) -> float:
        """The criterion of a plan, the more the better."""
        M = self.eye + np.einsum("nrp,nrq->pq", self.rows[plan], self.rows[plan])
        if self.name == "D":
            scale = 2.0 * np.linalg.slogdet(self.V)[1]
            return float(np.exp((np.linalg.slogdet(M)[1] - scale) / len(M)))
        if self.name == "E":
            return float(1.0 / np.linalg.eigvalsh(self.V @ np.linalg.solve(M, self.V.T))[-1])
        return float(1.0 / np.trace(np.linalg.solve(M, self.C)))

    def _tried(self, rest: IntArray) -> Array:
        """What each candidate would bring to the other poses, by a rule that keeps the order."""
        base = self.eye + np.einsum("nrp,nrq->pq", self.rows[rest], self.rows[rest])
        inverse = np.linalg.inv(base)
        U = self.rows @ inverse
        S = np.eye(self.rows.shape[1]) + U @ np.swapaxes(self.rows, 1, 2)
        if self.name == "D":
            return np.asarray(np.linalg.slogdet(S)[1])
        if self.name == "E":
            return self._smallest(inverse, U, S)
        return np.asarray(np.einsum("nij,nij->n", np.linalg.solve(S, U @ self.C), U))

    def _smallest(self, inverse: Array, U: Array, S: Array) -> Array:
        """1 / the largest eigenvalue, of the fifty that lower the largest one most to first order."""
        _, vectors = np.linalg.eigh(self.V @ inverse @ self.V.T)
        along = U @ (self.V.T @ vectors[:, -3:])
        top = np.argsort(-np.einsum("nij,nij->n", along, np.linalg.solve(S, along)))[:50]
        found = np.full(len(U), -np.inf)
        down = np.swapaxes(U[top], 1, 2) @ np.linalg.solve(S[top], U[top])
        found[top] = 1.0 / np.linalg.eigvalsh(self.V @ (inverse - down) @ self.V.T)[:, -1]
        return found

    def improved(self, plan: IntArray) -> tuple[IntArray, float]:
        """Exchanges until none helps."""
        plan, value, idle = plan.copy(), self.value(plan), 0
        while idle < len(plan):
            for slot in range(len(plan)):
                rest = np.delete(plan, slot)
                gains = self._tried(rest)
                gains[rest] = -np.inf
                trial = np.append(rest, gains.argmax())
                found = self.value(trial)
                idle += 1
                if found > value * (1.0 + _WORTH):
                    plan[slot], value, idle = trial[-1], found, 0
                if idle >= len(plan):
                    break
        return plan, value

    def best(self, starts: int, rng: np.random.Generator) -> tuple[float, Array]:
        """Value of the best plan of random starts and kicks, and of the starts alone."""
        count = len(self.rows)
        found = [self.improved(rng.choice(count, self.poses, replace=False)) for _ in range(starts)]
        plan, value = max(found, key=lambda pair: pair[1])
        for _ in range(_KICKS):
            trial = plan.copy()
            slots = rng.choice(self.poses, min(3, self.poses), replace=False)
            trial[slots] = rng.choice(np.setdiff1d(np.arange(count), trial), len(slots), False)
            trial, new = self.improved(trial)
            if new > value:
                plan, value = trial, new
        return value, np.array([value for _, value in found])


def one(index: int, seed: int, starts: int) -> Row:
    """Both ways on one problem."""
    drawn = draw(index, seed)
    criterion, (n, rank, p) = drawn.form, drawn.rows.shape
    blocks = Blocks(
        pack(np.swapaxes(drawn.rows, 1, 2) @ drawn.rows), RIDGE * np.eye(p), min(rank, p)
    )
    posed = Selection(criterion, blocks, Allowed.any_of(n, drawn.poses))
    relaxed, relax_s = clocked(lambda: relax(posed))
    found, search_s = clocked(lambda: best_plan(posed, relaxed, seed=seed))
    row = {
        "problem": index, "criterion": drawn.criterion, "joints": drawn.joints, "p": p,
        "rows": rank, "candidates": n, "poses": drawn.poses, "ours": found.value,
        "bound": relaxed.bound, "relaxation_s": relax_s, "search_s": search_s,
    }  # fmt: skip
    if starts:
        rng = np.random.default_rng(seed)
        (value, ends), seconds = clocked(lambda: Plain(drawn).best(starts, rng))
        row |= {"plain": value, "plain_median": float(np.median(ends)), "plain_s": seconds}
    return row


@bench(
    count("--problems", 50),
    count("--starts", 60, least=0, help="Of the plain exchange, 0 for ours alone."),
    workers=True,
)
def main(problems: int, starts: int, seed: int, workers: int) -> Output:
    """Compare value and time."""
    tasks = ((index,) for index in range(problems))
    rows = each(one, tasks, workers, seed=seed, starts=starts)
    parts: list[Any] = [table(map(_line, rows))]
    if starts:
        gains = np.array([r["ours"] / r["plain"] - 1.0 for r in rows])
        ours = sum(r["relaxation_s"] + r["search_s"] for r in rows)
        parts.append(
            f"worse by more than {100.0 * _WORSE:g} %: {(gains < -_WORSE).sum()} of {len(rows)}, "
            f"worst {100.0 * gains.min():+.2f} %, median {100.0 * np.median(gains):+.2f} %; "
            f"CPU {ours:.0f} s against {sum(r['plain_s'] for r in rows):.0f} s"
        )
    return parts, {"seed": seed, "starts": starts, "problems": rows}


def _line(row: Row) -> Row:
    plain = row.get("plain")
    return {
        "problem": f"{row['problem']} {row['criterion']}",
        "p": row["p"],
        "poses": row["poses"],
        "candidates": row["candidates"],
        "efficiency\nproved": f"{row['ours'] / row['bound']:.4f}",
        "over plain\nexchange [%]": plain and f"{100.0 * (row['ours'] / plain - 1.0):+.2f}",
        "relaxation\n[s]": f"{row['relaxation_s']:.2f}",
        "search\n[s]": f"{row['search_s']:.2f}",
        "plain\n[s]": plain and f"{row['plain_s']:.1f}",
    }


if __name__ == "__main__":
    main()
