"""Optimal plans by posecal and by other programs, from the same information of the candidates."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calib.arrays import Array
from calib.threads import one_blas_thread
from doe.criteria.determinant import Determinant
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import unpack
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from studies.research.bench import Row, timed
from studies.research.peers.run import HERE, Left, said_by
from studies.research.problems import blocks_of, paper_cell, pool, problem

LIMIT = 1800.0  # seconds for one peer
_CANDIDATES, _POSES = 200, 20


@one_blas_thread
def beside(pythons: Mapping[str, Path]) -> tuple[list[Row], list[str]]:
    """Plans beside Detmax of FIGAROH, weights beside pydex; and a line for each that does not run."""
    rows: list[Row] = []
    skipped: list[str] = []
    for name in ("figaroh", "pydex"):
        if name in pythons:
            matrices = _information(geometric=name == "figaroh")
            own = _chosen(matrices) if name == "figaroh" else _weighed(matrices)
            theirs = _of_peer(name, str(pythons[name]), matrices)
            skipped += [str(theirs)] if isinstance(theirs, Left) else []
            for row in (own, *(theirs if isinstance(theirs, list) else ())):
                times = row["seconds"] / own["seconds"]
                over = row["det(M)^(1/p)"] / own["det(M)^(1/p)"]
                rows.append({**row, "time [x posecal]": times, "value [x posecal]": over})
    return rows, skipped


def _information(geometric: bool) -> Array:
    """Of each candidate, shape (n, p, p)."""
    posed = problem(paper_cell(geometric=geometric), "D")
    return unpack(pool(posed, _CANDIDATES).packed)


def _posed(matrices: Array, poses: int, repeats: bool) -> Selection:
    criterion = Determinant(np.eye(matrices.shape[-1]))
    rules = Allowed.any_of(len(matrices), poses, repeats=repeats)
    return Selection(criterion, blocks_of(matrices), rules)


def _row(program: str, way: str, seconds: float, value: float) -> Row:
    return {"program": program, "way": way, "seconds": seconds, "det(M)^(1/p)": value}


def _chosen(matrices: Array) -> Row:
    """Detmax may repeat a candidate, so posecal may as well."""
    posed = _posed(matrices, _POSES, repeats=True)
    plan, seconds = timed(lambda: best_plan(posed, relax(posed), seed=0))
    return _row("posecal", f"plan of {_POSES}, with its bound", seconds, plan.value)


def _weighed(matrices: Array) -> Row:
    posed = _posed(matrices, 1, repeats=True)
    relaxed, seconds = timed(lambda: relax(posed))
    return _row("posecal", "weights", seconds, relaxed.value)


def _of_peer(name: str, python: str, matrices: Array) -> list[Row] | Left:
    """What the peer answers, judged by posecal's criterion."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "blocks.npz"
        np.savez(path, matrices=matrices)
        # -P: what is beside the script is not what the program imports.
        run = [python, "-P", str(HERE / "drive_designs.py"), name, str(path), str(_POSES)]
        said = said_by(run, LIMIT, name, Path(folder))
    if isinstance(said, Left):
        return said
    answer = json.loads(said.strip().splitlines()[-1])
    rows, blocks = [], blocks_of(matrices)
    for own in answer["runs"]:
        if "plan" in own:
            M = blocks.total(np.array(own["plan"]))
        else:
            weights = np.array(own["weights"])
            M = blocks.total(np.arange(len(weights)), weights / weights.sum())
        value = float(Determinant(np.eye(len(M))).value(M))
        rows.append(_row(f"{name} {answer['version']}", own["way"], own["seconds"], value))
    return rows
