"""Letting a program answer the cases: one process a case, a limit on its time, answers committed."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from studies.research.withheld.seal import (
    DIAGNOSIS,
    answers_folder,
    case_names,
    commit_answers,
    commitment_of,
    read_json,
)

DIAGNOSE = shlex.join(
    [
        *(sys.executable, "-c", "from studies.cli import run; run()", "diagnose"),
        *("{cell}", "{data}", "--holdout", "{heldout}", "--json", "{answer}"),
    ]
)
"""``posecal diagnose CELL DATA --holdout HELDOUT --json ANSWER`` of the package that runs this."""
RIVALS = {
    name: shlex.join(
        [
            *(sys.executable, "-m", "studies.research.rivals", name),
            *("{cell}", "{data}", "{heldout}", "{answer}"),
        ]
    )
    for name in ("aic", "bic", "black-box")
}
"""Simple programs for the same cases, by the names of their answers."""
COMMANDS = {DIAGNOSIS: DIAGNOSE, **RIVALS}


def run(
    folder: Path,
    *,
    program: str = DIAGNOSIS,
    command: str | None = None,
    workers: int = 1,
    limit: float = 120.0,
    first: int | None = None,
    progress: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Let one program answer every case anew and commit its answers; those of others stay.

    program : name of the answers, which lie in a folder of that name
    command : template with {cell}, {data}, {heldout} and {answer}, which are absolute paths; by
        default that of ``COMMANDS``
    limit : s, for one case; first : how many cases, all without
    Returns what became of each case: "answered", "failed" or "too slow", and its seconds.
    """
    names = case_names(folder)[:first]
    parts = shlex.split(COMMANDS[program] if command is None else command)
    answers = answers_folder(folder, program).resolve()
    commitment_of(folder, program).unlink(missing_ok=True)
    shutil.rmtree(answers, ignore_errors=True)
    answers.mkdir(parents=True)

    def one(name: str) -> dict[str, Any]:
        found = _answer(folder / "cases" / name, answers, parts, limit)
        progress()
        return found

    with ThreadPoolExecutor(workers) as pool:
        runs = dict(zip(names, pool.map(one, names), strict=True))
    commit_answers(folder, runs, parts, program)
    return runs


def _answer(case: Path, answers: Path, parts: list[str], limit: float) -> dict[str, Any]:
    case = case.resolve()
    paths = {
        "cell": case / "cell.toml",
        "data": case / "measurements.csv",
        "heldout": case / "heldout.csv",
        "answer": answers / f"{case.name}.json",
    }
    command = [part.format(**paths) for part in parts]
    begun = time.perf_counter()
    with (answers / f"{case.name}.log").open("wb") as log:
        try:
            done = subprocess.run(  # noqa: S603
                command,
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                timeout=limit,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                check=False,
            )
            status = "answered" if done.returncode == 0 and _readable(paths["answer"]) else "failed"
        except subprocess.TimeoutExpired:
            status = "too slow"
    if status != "answered":
        paths["answer"].unlink(missing_ok=True)
    return {"status": status, "seconds": round(time.perf_counter() - begun, 3)}


def _readable(path: Path) -> bool:
    try:
        return isinstance(read_json(path), dict)
    except (OSError, ValueError):
        return False
