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

from studies.withheld.seal import ANSWERS, case_names, commit_answers, read_json

DIAGNOSE = shlex.join(
    [
        *(sys.executable, "-c", "from studies.cli import run; run()", "diagnose"),
        *("{cell}", "{data}", "--holdout", "{heldout}", "--json", "{answer}"),
    ]
)
"""``posecal diagnose CELL DATA --holdout HELDOUT --json ANSWER`` of the package that runs this."""


def run(
    folder: Path,
    *,
    command: str = DIAGNOSE,
    workers: int = 1,
    limit: float = 120.0,
    progress: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Answer every case anew and commit the answers.

    command : template with {cell}, {data}, {heldout} and {answer}, which are absolute paths
    limit : s, for one case
    Returns what became of each case: "answered", "failed" or "too slow", and its seconds.
    """
    names = case_names(folder)
    parts = shlex.split(command)
    (folder / ANSWERS).unlink(missing_ok=True)
    shutil.rmtree(folder / "answers", ignore_errors=True)
    (folder / "answers").mkdir()

    def one(name: str) -> dict[str, Any]:
        found = _answer(folder, name, parts, limit)
        progress()
        return found

    with ThreadPoolExecutor(workers) as pool:
        runs = dict(zip(names, pool.map(one, names), strict=True))
    commit_answers(folder, runs, parts)
    return runs


def _answer(folder: Path, name: str, parts: list[str], limit: float) -> dict[str, Any]:
    case, answers = (folder / "cases" / name).resolve(), (folder / "answers").resolve()
    paths = {
        "cell": case / "cell.toml",
        "data": case / "measurements.csv",
        "heldout": case / "heldout.csv",
        "answer": answers / f"{name}.json",
    }
    command = [part.format(**paths) for part in parts]
    begun = time.perf_counter()
    with (answers / f"{name}.log").open("wb") as log:
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
