"""Whole plans of random arms beside a plain exchange: what is lost to it, and in how much time.

    python -m studies.research.plans [--problems 50] [--starts 60] [--json FILE]

An arm of four to seven joints with one to three markers, 6 to 42 parameters drawn from its base, its
links, its compliances and its markers, a pool of 500 to 2000 poses, and plans of 1.2 to 2.5 times the
poses that the count of rows asks for; criteria in turn. The plain exchange is what a user writes in a
day: from random plans each pose is tried against every candidate until none helps, and the best plan is
kicked and improved again. Both are timed in CPU seconds, ours with the relaxation that its proof needs.
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

CRITERIA = ("D", "A", "E", "task")
_JOINTS, _PARAMETERS, _POOL = (4, 7), (6, 42), (500, 2000)
_SPARE = (1.2, 2.5)  # poses over the least that could do
_KICKS = 30  # after the last start that the plain exchange makes from its best plan
_WORTH, _WORSE = 1e-7, 1e-3  # share that is worth an exchange, and by which a plan counts as worse
_TURN, _SHIFT, _COMPLIANCE = 1e-3, 1e-3, 1e-6  # rad, m, rad/(N m)
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
    candidates, goals = int(rng.integers(*_POOL, endpoint=True)), int(rng.choice([1, 3, 20]))
    q = rng.uniform(-2.5, 2.5, (candidates + goals, joints))
    rows = _rows(*arm, points, q)
    rows = rows[..., _independent(rows, wanted, rng)]
    mean = np.einsum("nrp,nrq->pq", rows, rows) / len(rows)
    T = np.linalg.inv(np.linalg.cholesky(mean)).T
    turned = rows @ T
    p, r = rows.shape[2], int(np.linalg.matrix_rank(rows[:9], rtol=1e-9).max())
    poses = max(3, round(p / r * rng.uniform(*_SPARE)))
    targets = turned[candidates:].reshape(-1, p) / np.sqrt(goals * markers)
    name = CRITERIA[index % len(CRITERIA)]
    return Drawn(joints, name, poses, turned[:candidates], targets, T)


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
            R = R @ Rotation.from_rotvec(np.outer(q[:, k], [0.0, 0.0, 1.0])).as_matrix()
        frames.append((R, at))
    markers, columns = at[:, None] + points @ np.swapaxes(R, 1, 2), []
    for k, (axes, origin) in enumerate(frames):
        levers = (markers - origin[:, None])[:, None]  # (n, 1, markers, 3)
        along = np.swapaxes(axes, 1, 2)[:, :, None]  # (n, 3, 1, 3)
        turned = np.cross(along, levers)
        columns += [turned * _TURN, np.broadcast_to(along, turned.shape) * _SHIFT]
        if 0 < k < len(frames) - 1:
            torque = (axes[:, :, 2] * np.cross(at - origin, _LOAD)).sum(axis=1)
            columns.append(turned[:, 2:] * torque[:, None, None, None] * _COMPLIANCE)
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
        self.rows, self.poses, self.name, self.V = drawn.rows, drawn.poses, drawn.criterion, drawn.V
        form = drawn.form
        self.C = form.F @ form.F.T if isinstance(form, Task | Average) else drawn.V.T @ drawn.V

    def _information(self, plan: IntArray) -> Array:
        rows = self.rows[plan]
        M = RIDGE * np.eye(rows.shape[2]) + np.einsum("nrp,nrq->pq", rows, rows)
        return np.asarray(M)

    def value(self, plan: IntArray) -> float:
        """The criterion of a plan, the more the better."""
        M = self._information(plan)
        if self.name == "D":
            scale = 2.0 * np.linalg.slogdet(self.V)[1]
            return float(np.exp((np.linalg.slogdet(M)[1] - scale) / len(M)))
        if self.name == "E":
            return float(1.0 / np.linalg.eigvalsh(self.V @ np.linalg.solve(M, self.V.T))[-1])
        return float(1.0 / np.trace(np.linalg.solve(M, self.C)))

    def _tried(self, rest: IntArray) -> Array:
        """What each candidate would bring to the other poses, by a rule that keeps the order."""
        inverse = np.linalg.inv(self._information(rest))
        U = self.rows @ inverse
        S = np.eye(self.rows.shape[1]) + U @ np.swapaxes(self.rows, 1, 2)
        if self.name == "D":
            return np.asarray(np.linalg.slogdet(S)[1])
        if self.name != "E":
            return np.asarray(np.einsum("nij,nij->n", np.linalg.solve(S, U @ self.C), U))
        # 1 / the largest eigenvalue, of the fifty that lower it most to first order.
        _, vectors = np.linalg.eigh(self.V @ inverse @ self.V.T)
        along = U @ (self.V.T @ vectors[:, -3:])
        top = np.argsort(-np.einsum("nij,nij->n", along, np.linalg.solve(S, along)))[:50]
        tried = np.full(len(U), -np.inf)
        down = np.swapaxes(U[top], 1, 2) @ np.linalg.solve(S[top], U[top])
        tried[top] = 1.0 / np.linalg.eigvalsh(self.V @ (inverse - down) @ self.V.T)[:, -1]
        return tried

    def improved(self, plan: IntArray) -> tuple[IntArray, float]:
        """Exchanges until none helps."""
        plan, value, idle, slot = plan.copy(), self.value(plan), 0, 0
        while idle < len(plan):
            rest = np.delete(plan, slot)
            gains = self._tried(rest)
            gains[rest] = -np.inf
            trial = np.append(rest, gains.argmax())
            reached = self.value(trial)
            idle += 1
            if reached > value * (1.0 + _WORTH):
                plan[slot], value, idle = trial[-1], reached, 0
            slot = (slot + 1) % len(plan)
        return plan, value

    def best(self, starts: int, rng: np.random.Generator) -> float:
        """Value of the best plan of random starts and kicks."""
        n = len(self.rows)
        ends = [self.improved(rng.choice(n, self.poses, replace=False)) for _ in range(starts)]
        plan, value = max(ends, key=lambda pair: pair[1])
        for _ in range(_KICKS):
            trial = plan.copy()
            slots = rng.choice(self.poses, min(3, self.poses), replace=False)
            trial[slots] = rng.choice(np.setdiff1d(np.arange(n), trial), len(slots), False)
            trial, new = self.improved(trial)
            if new > value:
                plan, value = trial, new
        return value


def one(index: int, seed: int, starts: int) -> Row:
    """Both ways on one problem."""
    drawn = draw(index, seed)
    n, rank, p = drawn.rows.shape
    packed = pack(np.swapaxes(drawn.rows, 1, 2) @ drawn.rows)
    blocks = Blocks(packed, RIDGE * np.eye(p), min(rank, p))
    posed = Selection(drawn.form, blocks, Allowed.any_of(n, drawn.poses))
    relaxed, relax_s = clocked(lambda: relax(posed))
    found, search_s = clocked(lambda: best_plan(posed, relaxed, seed=seed))
    row = {
        "problem": f"{index} {drawn.criterion}", "joints": drawn.joints, "p": p, "poses": drawn.poses,
        "candidates": n, "value": found.value, "proved": found.value / relaxed.bound,
        "relax [s]": relax_s, "search [s]": search_s,
    }  # fmt: skip
    if starts:
        rng = np.random.default_rng(seed)
        value, seconds = clocked(lambda: Plain(drawn).best(starts, rng))
        row |= {"gain": found.value / value - 1.0, "plain [s]": seconds}
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
    parts: list[Any] = [table(rows)]
    if starts:
        gains = np.array([row["gain"] for row in rows])
        ours = sum(row["relax [s]"] + row["search [s]"] for row in rows)
        theirs = sum(row["plain [s]"] for row in rows)
        parts.append(
            f"worse by more than {_WORSE:g}: {(gains < -_WORSE).sum()} of {len(rows)}, better: "
            f"{(gains > _WORSE).sum()}; median {100.0 * np.median(gains):+.2f} %; plain exchange "
            f"{theirs:.0f} s, ours {ours:.0f} s"
        )
    return parts, {"seed": seed, "starts": starts, "problems": rows}


if __name__ == "__main__":
    main()
