"""posecal beside other programs, on the same blocks."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.threads import one_blas_thread
from doe.criteria.determinant import Determinant
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.exchange import exchange, greedy, rounded_weights
from doe.optimal.packed import unpack
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from studies.research.benchmarks.design_runs import (
    Row,
    any_of,
    blocks_of,
    master,
    one_thread,
    pool,
    problem,
    rank_one,
    timed,
)

LIMIT = 1800.0  # seconds for one peer
OWN = ("relax + best_plan", "relax, one start + exchange", "greedy + exchange")

_R = """
given <- commandArgs(trailingOnly = TRUE)
Fx <- unname(as.matrix(read.csv(given[1], header = FALSE)))
N <- as.integer(given[2])
limit <- as.numeric(given[3])
set.seed(1)
report <- function(package, way, run) {
  if (!requireNamespace(package, quietly = TRUE)) {
    cat("MISSING", package, "\\n", sep = "|")
  } else {
    seconds <- system.time(chosen <- run())[["elapsed"]]
    version <- as.character(packageVersion(package))
    cat("FOUND", package, version, way, seconds, paste(chosen, collapse = " "), "\\n", sep = "|")
  }
}
report("AlgDesign", "optFederov", function() {
  AlgDesign::optFederov(data = Fx, nTrials = N, criterion = "D")$rows
})
report("OptimalDesign", paste("od_KL,", limit, "s"), function() {
  w <- OptimalDesign::od_KL(Fx, N, bin = TRUE, t.max = limit, echo = FALSE, track = FALSE)$w.best
  which(w > 0.5)
})
"""


@dataclass
class Comparison:
    """rows : figures of every program; skipped : a line for each that is not there."""

    rows: list[Row] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def geometric(count: int) -> Array:
    """Blocks of the geometric problem, shape (n, 33, 33)."""
    return _matrices("geometric", count)


def _matrices(case: str, count: int) -> Array:
    posed = problem(case, "D")
    return unpack(pool(posed, count).packed)


@one_blas_thread
def compare(python: str, quick: bool) -> Comparison:
    """All peers, each skipped with a line where it is not installed."""
    found = Comparison()
    count = 200 if quick else 1000
    with master(None):
        _beside_figaroh(found, python, geometric(count))
        _beside_pydex(found, python, _matrices("elastic", count))
        _beside_r(found, count if quick else 10_000, 2.0 if quick else 15.0)
    return found


@one_blas_thread
def beside(pythons: Mapping[str, Path], quick: bool) -> Comparison:
    """Those peers that have an interpreter of their own, by name; R is not asked."""
    found, count = Comparison(), 200 if quick else 1000
    asked = {"figaroh": ("geometric", _beside_figaroh), "pydex": ("elastic", _beside_pydex)}
    with master(None):
        for name, (case, run) in asked.items():
            if name in pythons:
                run(found, str(pythons[name]), _matrices(case, count))
    return found


def _beside_figaroh(found: Comparison, python: str, matrices: Array, poses: int = 20) -> None:
    blocks, task = blocks_of(matrices), _task(matrices, poses)
    rules = any_of(len(matrices), poses)
    own = _own_rows(blocks, rules, task)
    best = own[0]
    found.rows += own
    # Detmax may repeat a candidate, so posecal is shown with repeats as well.
    free = any_of(len(matrices), poses, repeats=True)
    row = _own_rows(blocks, free, task)[0]
    found.rows.append({**row, "way": row["way"] + ", repeats allowed"})
    answer = _peer(found, python, "figaroh", matrices, poses)
    for run in answer.get("runs", []):
        plan = np.array(run["plan"])
        value = _value(blocks, plan)
        found.rows.append(
            {
                "task": task,
                "program": f"figaroh {answer['version']}",
                "way": f"{run['way']}, {len(np.unique(plan))} distinct",
                "seconds": run["seconds"],
                "det(M)^(1/p)": value,
                "time [x posecal]": run["seconds"] / best["seconds"],
                "value [x posecal]": value / best["det(M)^(1/p)"],
            }
        )


def _beside_pydex(found: Comparison, python: str, matrices: Array) -> None:
    n, p = len(matrices), matrices.shape[-1]
    blocks, rules = blocks_of(matrices), any_of(n, 1, repeats=True)
    task = f"D weights, p {p}, {n} candidates"
    relaxed, seconds = timed(lambda: relax(Determinant(np.eye(p)), blocks, rules))
    found.rows.append(_row(task, "relax", seconds, relaxed.value) | {"proved within": relaxed.gap})
    answer = _peer(found, python, "pydex", matrices, 1)
    for run in answer.get("runs", []):
        weights = np.array(run["weights"])
        M = blocks.total(np.arange(n), weights / weights.sum())
        value = float(Determinant(np.eye(p)).value(M))
        found.rows.append(
            {
                "task": task,
                "program": f"pydex {answer['version']}",
                "way": f"cvxpy, {run['way']}",
                "seconds": run["seconds"],
                "det(M)^(1/p)": value,
                "time [x posecal]": run["seconds"] / seconds,
                "value [x posecal]": value / relaxed.value,
                "proved within": float(blocks.scores(np.asarray(np.linalg.inv(M))).max()) / p - 1.0,
            }
        )


def _beside_r(found: Comparison, count: int, limit: float, poses: int = 18) -> None:
    posed = problem("elastic", "D")
    q = pool(posed, count).q
    rng = np.random.default_rng(0)
    rows = np.concatenate([posed.regressor.rows(part) for part in np.array_split(q, 10)])
    rows = rows[np.arange(count), rng.integers(rows.shape[1], size=count)]
    blocks, rules = rank_one(rows), any_of(count, poses)
    task = f"D, rank one, p {rows.shape[1]}, choose {poses} of {count}"
    own = _own_rows(blocks, rules, task)
    found.rows += own
    program = shutil.which("Rscript")
    if program is None:
        found.skipped.append("AlgDesign, OptimalDesign: Rscript is not installed")
        return
    with tempfile.TemporaryDirectory() as folder:
        table, script = Path(folder) / "rows.csv", Path(folder) / "peers.R"
        np.savetxt(table, rows, delimiter=",")
        script.write_text(_R)
        done = subprocess.run(  # noqa: S603
            [program, str(script), str(table), str(poses), str(limit)],
            capture_output=True,
            text=True,
            timeout=LIMIT,
            env=one_thread(),
        )
    lines = [line.split("|") for line in done.stdout.splitlines()]
    found.skipped += [f"{line[1]}: not installed in R" for line in lines if line[0] == "MISSING"]
    if done.returncode:
        found.skipped.append(f"R: {done.stderr.strip().splitlines()[-1]}")
    for _, package, version, way, seconds, chosen, *_ in (x for x in lines if x[0] == "FOUND"):
        value = _value(blocks, np.array(chosen.split(), dtype=int) - 1)
        found.rows.append(
            {
                "task": task,
                "program": f"{package} {version}",
                "way": way,
                "seconds": float(seconds),
                "det(M)^(1/p)": value,
                "time [x posecal]": float(seconds) / own[0]["seconds"],
                "value [x posecal]": value / own[0]["det(M)^(1/p)"],
            }
        )


def _own_rows(blocks: Blocks, rules: Allowed, task: str) -> list[Row]:
    """The whole search with its proof, one start of it with the proof, and one start without."""
    criterion = Determinant(np.eye(len(blocks.fixed)))

    def searched() -> tuple[float, float]:
        relaxed = relax(criterion, blocks, rules)
        value = best_plan(criterion, blocks, rules, relaxed, seed=0).value
        return value, relaxed.bound / value - 1.0

    def once() -> tuple[float, float]:
        relaxed = relax(criterion, blocks, rules)
        start = rounded_weights(rules, relaxed.index, relaxed.weights, None)
        value = exchange(criterion, blocks, rules, start)[1]
        return value, relaxed.bound / value - 1.0

    def greedily() -> tuple[float, float]:
        start = greedy(criterion, blocks, rules)
        return exchange(criterion, blocks, rules, start)[1], np.nan

    rows: list[Row] = []
    for way, work in zip(OWN, (searched, once, greedily), strict=True):
        (value, gap), seconds = timed(work)
        row = _row(task, way, seconds, value)
        if rows:
            row["time [x posecal]"] = seconds / rows[0]["seconds"]
            row["value [x posecal]"] = value / rows[0]["det(M)^(1/p)"]
        rows.append(row | {"proved within": None if np.isnan(gap) else gap})
    return rows


def _row(task: str, way: str, seconds: float, value: float) -> Row:
    return {
        "task": task,
        "program": "posecal",
        "way": way,
        "seconds": seconds,
        "det(M)^(1/p)": value,
        "time [x posecal]": 1.0,
        "value [x posecal]": 1.0,
    }


def _task(matrices: Array, poses: int) -> str:
    return f"D, p {matrices.shape[-1]}, choose {poses} of {len(matrices)}"


def _value(blocks: Blocks, plan: IntArray) -> float:
    return float(Determinant(np.eye(len(blocks.fixed))).value(blocks.total(plan)))


def _peer(found: Comparison, python: str, name: str, matrices: Array, poses: int) -> Row:
    """What the peer answers; empty, with a line said, where it cannot be run."""
    script = Path(__file__).with_name("design_peer.py")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "blocks.npz"
        np.savez(path, matrices=matrices)
        run = [
            python,
            "-P",
            str(script),
            name,
            str(path),
            str(poses),
        ]  # -P: ours is not its `types`
        try:
            done = subprocess.run(  # noqa: S603
                run, capture_output=True, text=True, timeout=LIMIT, cwd=folder, env=one_thread()
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            found.skipped.append(f"{name}: {error}")
            return {}
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no message"])[-1]
        found.skipped.append(f"{name}: skipped, {said}")
        return {}
    answer: Row = json.loads(done.stdout.strip().splitlines()[-1])
    return answer
