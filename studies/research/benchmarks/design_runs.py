"""What ``benchmarks.design`` measures, one case at a time, each in a process of its own.

    python -m studies.research.benchmarks.design_runs NAME JSON

calls the function NAME of ``RUNS`` with the arguments in JSON and prints the figures as JSON. A fresh
process makes peak memory mean something, and a solver that takes too long can be stopped.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
import scipy.linalg  # noqa: F401 -- with its threads, before they are limited

import calib
from calib import Cell
from calib.arrays import Array
from calib.cell.planned import Planned, Targets
from calib.files.write import json_text
from calib.threads import one_blas_thread
from doe.criteria import Criterion
from doe.criteria.determinant import Determinant
from doe.criteria.trace import Trace
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.branch import prove
from doe.optimal.certify import bound, survivors
from doe.optimal.packed import pack, packed_size
from doe.optimal.relax import Relaxation, bounded, relax
from doe.optimal.search import Found, best_plan
from doe.problem import RIDGE, Problem, problem_of
from doe.problem.levels import levels_of, parse_levels
from doe.problem.pool import Pool, drawn, pool_of
from doe.problem.request import Request
from studies.demo.embedded import embedded_cell, embedded_text

Row = dict[str, Any]  # heading -> figure
T = TypeVar("T")

ELASTIC = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
LEVELS = "A2=-140,-99.85,-56.9,-25.24,-0.01x3"  # Table II of the paper
TARGETS = """pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg
t1,0,-90,90,0,45,0
t2,30,-70,100,20,60,30
t3,-30,-50,80,-30,-45,10
"""
MASTERS = {"conic": False, "interior point": True}  # whether smooth criteria go to the latter
ENOUGH = 2.0  # seconds of repeated runs after which there are no more


@dataclass(frozen=True)
class Case:
    """A model of the embedded cell. The levels are those of Table II, or none."""

    effects: tuple[str, ...]
    poses: int = 20
    levels: str | None = None
    loaded: bool = True
    masses: bool = True


CASES = {
    "paper": Case(ELASTIC, 15, LEVELS),
    "paper, no masses": Case(ELASTIC, 15, LEVELS, masses=False),
    "elastic": Case(ELASTIC),
    "elastic + base": Case(("base", *ELASTIC)),
    "elastic + base, tool": Case(("base", "tool", *ELASTIC)),
    "geometric": Case(("base", "tool", "geometry"), loaded=False),
    "all": Case(("base", "tool", "geometry", *ELASTIC)),
}


def problem(name: str, criterion: str) -> Problem:
    """The design problem of a case, targets those of the milling task."""
    case = CASES[name]
    with tempfile.TemporaryDirectory() as folder:
        targets = Path(folder) / "targets.csv"
        targets.write_text(TARGETS)
        cell: Cell = replace(embedded_cell(), effects=case.effects)
        if not case.loaded:
            cell = replace(cell, load=None)
        if not case.masses:
            robot = replace(cell.robot, masses=np.zeros_like(cell.robot.masses))
            cell = replace(cell, robot=robot)
        own = Targets(targets, *calib.load_targets(cell, targets))
        cell = replace(cell, design=Planned(targets=own))
        asked = parse_levels(cell, case.levels) if case.levels else None
        levels = levels_of(cell, asked, case.poses)
        return problem_of(cell, Request(case.poses, criterion, levels))


def pool(posed: Problem, count: int) -> Pool:
    """Candidates of a problem, seed 0."""
    levels = posed.request.levels
    chunks = drawn(posed.cell, count, levels, 0)
    return pool_of(posed.regressor, posed.constraints, levels, chunks, count)


def timed(work: Callable[[], T], enough: float = ENOUGH) -> tuple[T, float]:
    """Result and median seconds of three runs, fewer once they took ``enough`` seconds."""
    seconds: list[float] = []
    result: T | None = None
    while len(seconds) < 3 and sum(seconds) < enough:
        result = None  # two large results at once would count in the peak memory
        begun = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - begun)
    assert result is not None  # noqa: S101
    return result, statistics.median(seconds)


@contextmanager
def master(name: str | None) -> Iterator[None]:
    """Relax with one master program, or with its own choice; both are imported and warm."""
    rng = np.random.default_rng(0)
    blocks = rank_one(rng.normal(size=(50, 3)))
    for smooth in MASTERS.values():
        with patch.object(Determinant, "smooth", smooth):
            relax(Determinant(np.eye(3)), blocks, any_of(50, 6))
    with ExitStack() as chosen:
        for kind in (Determinant, Trace) if name else ():
            chosen.enter_context(patch.object(kind, "smooth", MASTERS[name or ""]))
        yield


def rank_one(rows: Array) -> Blocks:
    """Blocks of one row per candidate, (n, p)."""
    return blocks_of(rows[:, :, None] * rows[:, None, :])


def blocks_of(matrices: Array) -> Blocks:
    """Blocks of given information matrices, (n, p, p)."""
    rank = int(np.linalg.matrix_rank(matrices[:50], tol=1e-8).max())
    return Blocks(pack(matrices), RIDGE * np.eye(matrices.shape[-1]), rank)


def any_of(count: int, poses: int, repeats: bool = False) -> Allowed:
    """Any so many of the candidates."""
    group = np.zeros(count, dtype=int)
    return Allowed(group, np.zeros(1), np.array([poses]), 1, repeats=repeats)


def peak() -> float:
    """Peak memory of this process, MB."""
    import resource  # not on Windows

    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def solved(criterion: Criterion, blocks: Blocks, rules: Allowed) -> tuple[Row, Relaxation, Found]:
    """Relaxation and exchange with their seconds."""
    relaxed, relax_s = timed(lambda: relax(criterion, blocks, rules))
    found, exchange_s = timed(lambda: best_plan(criterion, blocks, rules, relaxed, seed=0))
    row = {
        "relaxation [s]": relax_s,
        "rounds": relaxed.rounds,
        "certified gap": relaxed.gap,
        "exchange [s]": exchange_s,
        "efficiency": found.value / relaxed.bound,
        "median start": float(np.median(found.starts)) / found.value,
    }
    return row, relaxed, found


def scaling(case: str, count: int, criteria: list[str]) -> Row:
    """Pool, relaxation and exchange of one pool size."""
    posed = problem(case, criteria[0])
    found, pool_s = timed(lambda: pool(posed, count), enough=60.0)
    pool_mb = peak()
    blocks, rules = posed.blocks(found), posed.rules(found.level)
    rows = []
    with master(None):
        for name in criteria:
            row, _, _ = solved(problem(case, name).criterion, blocks, rules)
            rows.append({"criterion": name, **row})
    columns = len(posed.model.parameters)
    assert blocks.packed.shape == (len(found), packed_size(columns))  # noqa: S101
    return {
        "candidates": count,
        "p": columns,
        "pool [s]": pool_s,
        "pool, peak [MB]": pool_mb,
        "all, peak [MB]": peak(),
        "solved": rows,
    }


def parameters(case: str, count: int, criterion: str, by: str) -> Row:
    """Relaxation with one master program."""
    posed = problem(case, criterion)
    found = pool(posed, count)
    blocks, rules = posed.blocks(found), posed.rules(found.level)
    with master(by):
        relaxed, seconds = timed(lambda: relax(posed.criterion, blocks, rules))
    return {
        "p": len(posed.model.parameters),
        "seconds": seconds,
        "rounds": relaxed.rounds,
        "certified gap": relaxed.gap,
    }


def efficiency(case: str, count: int, criterion: str) -> Row:
    """Relaxation and exchange with the master that ``relax`` takes by itself."""
    posed = problem(case, criterion)
    found = pool(posed, count)
    with master(None):
        row, _, _ = solved(posed.criterion, posed.blocks(found), posed.rules(found.level))
    return {"p": len(posed.model.parameters), "poses": posed.request.poses, **row}


def branch(case: str, count: int, criterion: str) -> Row:
    """Branch and bound after relaxation and exchange."""
    posed = problem(case, criterion)
    drawn_pool = pool(posed, count)
    blocks, rules = posed.blocks(drawn_pool), posed.rules(drawn_pool.level)
    with master(None):
        _, relaxed, found = solved(posed.criterion, blocks, rules)
        plain = posed.criterion.plain
        G = bounded(plain, blocks, rules, relaxed).G
        value = float(plain.value(blocks.total(found.plan)))
        left = survivors(G, blocks, rules, value)
        begun = time.perf_counter()
        proof = prove(plain, blocks, rules, found.plan, G, most_work=np.inf)
        seconds = time.perf_counter() - begun
    return {
        "gap of the relaxation": bound(G, blocks, rules) / proof.value - 1.0,
        "survivors": len(left),
        "optimal": proof.optimal,
        "nodes": proof.nodes,
        "seconds": seconds,
        "gap left": proof.bound / proof.value - 1.0,
        "gain over exchange": proof.value / value - 1.0,
    }


def command(criterion: str, candidates: int) -> Row:
    """Wall time of ``posecal design`` for the paper's case, files read and written."""
    lines = embedded_text("cell.toml").splitlines()
    table = next(i for i, line in enumerate(lines) if line.startswith("[design]"))
    lines.insert(table + 1, 'targets = "targets.csv"')
    model = next(i for i, line in enumerate(lines) if line.startswith("effects ="))
    lines[model] = f"effects = {json.dumps(ELASTIC)}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "cell.toml").write_text("\n".join(lines))
        (folder / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
        (folder / "targets.csv").write_text(TARGETS)
        run = [sys.executable, "-c", "from studies.cli import run; run()", "design"]
        run += [str(folder / "cell.toml"), "--levels", LEVELS, "--criterion", criterion]
        run += ["--candidates", str(candidates), "-o", str(folder / "plan.csv")]
        run += ["--json", str(folder / "result.json")]
        seconds = []
        for _ in range(3):
            begun = time.perf_counter()
            subprocess.run(run, check=True, stdout=subprocess.DEVNULL)  # noqa: S603
            seconds.append(time.perf_counter() - begun)
        result = json.loads((folder / "result.json").read_text())
    return {
        "criterion": criterion,
        "candidates": candidates,
        "seconds": statistics.median(seconds),
        "fastest [s]": min(seconds),
        "parts [s]": result["seconds_by_part"],
        "efficiency": result["efficiency"],
    }


RUNS: dict[str, Callable[..., Row]] = {
    f.__name__: one_blas_thread(f) for f in (scaling, parameters, efficiency, branch, command)
}


def in_child(name: str, limit: float | None = None, **arguments: Any) -> Row | None:
    """Figures of a run in a process of its own; None where it takes longer than ``limit`` seconds.

    A child's peak memory counts what its parent held when it was started: start them first.
    """
    run = [
        sys.executable,
        "-m",
        "studies.research.benchmarks.design_runs",
        name,
        json.dumps(arguments),
    ]
    try:
        done = subprocess.run(  # noqa: S603
            run, check=True, stdout=subprocess.PIPE, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return None
    found: Row = json.loads(done.stdout)
    return found


def one_thread() -> dict[str, str]:
    """The environment for peers, with one thread for their linear algebra."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    return {**os.environ, **dict.fromkeys(names, "1")}


if __name__ == "__main__":
    sys.stdout.write(json_text(RUNS[sys.argv[1]](**json.loads(sys.argv[2]))))
