"""Optimal plans by posecal and by other programs, from the same information of the candidates."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.threads import one_blas_thread
from doe.criteria.determinant import Determinant
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, unpack
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan, exchange, greedy, rounded_weights
from studies.research.bench import Row
from studies.research.benchmarks.design import blocks_of, pool, problem, timed
from studies.research.benchmarks.peers.judge import Left, said_by

LIMIT = 1800.0  # seconds for one peer
OWN = ("relax + best_plan", "relax, one start + exchange", "greedy + exchange")


@dataclass
class Comparison:
    """rows : figures of every program; skipped : a line for each that is not there."""

    rows: list[Row] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


@one_blas_thread
def beside(pythons: Mapping[str, Path], count: int = 200) -> Comparison:
    """Those peers that have an interpreter of their own, by name."""
    found = Comparison()
    asked = {"figaroh": ("geometric", _beside_figaroh), "pydex": ("elastic", _beside_pydex)}
    for name, (case, run) in asked.items():
        if name in pythons:
            run(found, str(pythons[name]), _matrices(case, count))
    return found


def _beside_figaroh(found: Comparison, python: str, matrices: Array, poses: int = 20) -> None:
    blocks, task = blocks_of(matrices), _task(matrices, poses)
    rules = Allowed.any_of(len(matrices), poses)
    own = _own_rows(blocks, rules, task)
    found.rows += own
    # Detmax may repeat a candidate, so posecal is shown with repeats as well.
    free = Allowed.any_of(len(matrices), poses, repeats=True)
    row = _own_rows(blocks, free, task)[0]
    found.rows.append({**row, "way": row["way"] + ", repeats allowed"})
    answer = _peer(found, python, "figaroh", matrices, poses)
    for run in answer.get("runs", []):
        plan = np.array(run["plan"])
        value = _value(blocks, plan)
        way, program = (
            f"{run['way']}, {len(np.unique(plan))} distinct",
            f"figaroh {answer['version']}",
        )
        found.rows.append(_row(task, way, run["seconds"], value, own[0], program))


def _beside_pydex(found: Comparison, python: str, matrices: Array) -> None:
    n, p = len(matrices), matrices.shape[-1]
    blocks, rules = blocks_of(matrices), Allowed.any_of(n, 1, repeats=True)
    task = f"D weights, p {p}, {n} candidates"
    relaxed, seconds = timed(lambda: relax(Selection(Determinant(np.eye(p)), blocks, rules)))
    first = _row(task, "relax", seconds, relaxed.value) | {"proved within": relaxed.gap}
    found.rows.append(first)
    answer = _peer(found, python, "pydex", matrices, 1)
    for run in answer.get("runs", []):
        weights = np.array(run["weights"])
        M = blocks.total(np.arange(n), weights / weights.sum())
        value = float(Determinant(np.eye(p)).value(M))
        gap = float(blocks.scores(np.asarray(np.linalg.inv(M))).max()) / p - 1.0
        way, program = f"cvxpy, {run['way']}", f"pydex {answer['version']}"
        row = _row(task, way, run["seconds"], value, first, program)
        found.rows.append(row | {"proved within": gap})


def _matrices(case: str, count: int) -> Array:
    """Information of each candidate of a case, shape (n, p, p)."""
    return unpack(pool(problem(case, "D"), count).packed)


def _own_rows(blocks: Blocks, rules: Allowed, task: str) -> list[Row]:
    """The whole search with its proof, one start of it with the proof, and one start without."""
    posed = Selection(Determinant(np.eye(len(blocks.fixed))), blocks, rules)

    def searched() -> tuple[float, float]:
        relaxed = relax(posed)
        value = best_plan(posed, relaxed, seed=0).value
        return value, relaxed.bound / value - 1.0

    def once() -> tuple[float, float]:
        relaxed = relax(posed)
        weights = np.bincount(relaxed.index, relaxed.weights, len(blocks)).astype(float)
        start = rounded_weights(rules, weights, None)
        value = exchange(posed, start)[1]
        return value, relaxed.bound / value - 1.0

    def greedily() -> tuple[float, float]:
        start = greedy(posed)
        return exchange(posed, start)[1], np.nan

    rows: list[Row] = []
    for way, work in zip(OWN, (searched, once, greedily), strict=True):
        (value, gap), seconds = timed(work)
        row = _row(task, way, seconds, value, rows[0] if rows else None)
        rows.append(row | {"proved within": None if np.isnan(gap) else gap})
    return rows


def _row(
    task: str,
    way: str,
    seconds: float,
    value: float,
    to: Row | None = None,
    program: str = "posecal",
) -> Row:
    """Figures of a run, and as multiples of another's."""
    own = {"seconds": seconds, "det(M)^(1/p)": value}
    to = to or own
    return {
        "task": task,
        "program": program,
        "way": way,
        **own,
        "time [x posecal]": seconds / to["seconds"],
        "value [x posecal]": value / to["det(M)^(1/p)"],
    }


def _task(matrices: Array, poses: int) -> str:
    return f"D, p {matrices.shape[-1]}, choose {poses} of {len(matrices)}"


def _value(blocks: Blocks, plan: IntArray) -> float:
    return float(Determinant(np.eye(len(blocks.fixed))).value(blocks.total(plan)))


def _peer(found: Comparison, python: str, name: str, matrices: Array, poses: int) -> Row:
    """What the peer answers; empty, with a line said, where it cannot be run."""
    script = Path(__file__).with_name("drive_designs.py")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "blocks.npz"
        np.savez(path, matrices=matrices)
        # -P: what stands beside the script is not what the program imports.
        run = [python, "-P", str(script), name, str(path), str(poses)]
        said = said_by(run, LIMIT, name, Path(folder))
    if isinstance(said, Left):
        found.skipped.append(str(said))
        return {}
    answer: Row = json.loads(said.strip().splitlines()[-1])
    return answer
