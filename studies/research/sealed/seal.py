"""Cases are made and programs answer; keys are committed before, answers before a key is opened."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

COMMITMENT = "commitment.json"
DIAGNOSIS = "diagnosis"
"""Name of the answers that are judged against the bars; other programs have names of their own."""
DIAGNOSE = shlex.join(
    [
        *(sys.executable, "-c", "from studies.cli import run; run()", "diagnose"),
        *("{cell}", "{data}", "--holdout", "{heldout}", "--json", "{answer}"),
    ]
)
"""``posecal diagnose CELL DATA --holdout HELDOUT --json ANSWER`` of the package that runs this."""


class BrokenSeal(Exception):
    """A file is not what was committed."""


def digest(path: Path) -> str:
    """sha256 of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_json(path: Path, content: Any) -> None:
    """Write JSON without NaN, whole or not at all."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8", newline="\n")
    draft.replace(path)


def read_json(path: Path) -> Any:
    """Read JSON."""
    return json.loads(path.read_text(encoding="utf-8"))


def case_names(folder: Path) -> list[str]:
    """Names of the cases that were committed."""
    return sorted(read_json(folder / COMMITMENT)["keys"])


def make(
    folder: Path,
    count: int,
    seed: int,
    progress: Callable[[], object] = lambda: None,
    *,
    population: str = "first",
) -> None:
    """Write cases of a population, keys, and last the commitment.

    Raises FileExistsError where the folder holds cases already.
    """
    import numpy as np

    from studies.research.sealed.populations import POPULATIONS, families

    if (folder / COMMITMENT).exists() or (folder / "cases").exists():
        raise FileExistsError(f"{folder}: holds cases already; name a new folder")
    (folder / "keys").mkdir(parents=True)
    own = POPULATIONS[population]
    drawn = families(np.random.default_rng([seed, count]), count, own.shares)
    for index, family in enumerate(drawn):
        name = f"case_{index:04d}"
        # Each index has its own stream of random numbers.
        case = own.draw(np.random.default_rng([seed, index]), family)
        own.write(folder / "cases" / name, case)
        # The salt keeps the hash from being found by trying all that could have been drawn.
        key = own.key(case, name, index, secrets.token_hex(16))
        write_json(folder / "keys" / f"{name}.json", key)
        progress()
    drawn_by = {} if population == "first" else {population: True}
    write_json(folder / "keys" / "seed.json", {"seed": seed, "count": count, **drawn_by})
    # Every key, and every file of every case so that none is exchanged.
    keys = {path.stem: digest(path) for path in sorted((folder / "keys").glob("case_*.json"))}
    paths = sorted((folder / "cases").glob("*/*"))
    files = {path.relative_to(folder / "cases").as_posix(): digest(path) for path in paths}
    write_json(folder / COMMITMENT, {"schema": 1, "keys": keys, "files": files})


def answers_folder(folder: Path, program: str) -> Path:
    """Where the answers of one program are, one file a case; their commitment beside it."""
    return folder / "answers" / program


def commit_answers(
    folder: Path, runs: dict[str, Any], command: list[str], program: str = DIAGNOSIS
) -> None:
    """Hash every answer of a program; a run that failed has none.

    The commitment to the keys is hashed too, so that answers belong to one set of keys.
    """
    for name, run in runs.items():
        path = answers_folder(folder, program) / f"{name}.json"
        run["sha256"] = digest(path) if path.exists() else None
    content = {"schema": 1, "command": command, "keys": digest(folder / COMMITMENT), "runs": runs}
    write_json(folder / "answers" / f"{program}.json", content)


@dataclass(frozen=True)
class Answered:
    """What one program said and did: answer by case, None for a run that failed, and its runs.

    Of all cases, or of the first.
    """

    answers: dict[str, Any]
    runs: dict[str, Any]


def opened(folder: Path) -> tuple[dict[str, Any], dict[str, Answered]]:
    """Keys by case, and what each program answered, the diagnosis first.

    All answers are checked before any key is read. Raises BrokenSeal where answers were not committed,
    or anything differs from what was.
    """
    if not (folder / COMMITMENT).exists():
        raise BrokenSeal(f"{folder}: holds no sealed cases; make them first")
    names = [path.stem for path in (folder / "answers").glob("*.json")]
    ordered = sorted(names, key=lambda name: (name != DIAGNOSIS, name))
    answered = {program: _committed(folder, program) for program in ordered}
    if not answered:
        raise BrokenSeal(f"{folder}: answers are not committed; run the diagnosis first")
    commitment = read_json(folder / COMMITMENT)
    for name, known in commitment["files"].items():
        _same(folder / "cases" / name, known)
    for name, known in commitment["keys"].items():
        _same(folder / "keys" / f"{name}.json", known)
    keys = {name: read_json(folder / "keys" / f"{name}.json") for name in commitment["keys"]}
    return keys, answered


def _committed(folder: Path, program: str) -> Answered:
    """The answers of one program, as they were committed."""
    committed = read_json(folder / "answers" / f"{program}.json")
    if committed["keys"] != digest(folder / COMMITMENT):
        raise BrokenSeal(f"{folder / COMMITMENT}: changed after the answers were committed")
    runs = committed["runs"]
    if sorted(runs) != case_names(folder)[: len(runs)]:
        raise BrokenSeal(f"{folder}: answers are of chosen cases; all of them, or the first, count")
    answers: dict[str, Any] = {}
    for name, run in runs.items():
        path = answers_folder(folder, program) / f"{name}.json"
        _same(path, run["sha256"])
        answers[name] = read_json(path) if run["sha256"] else None
    return Answered(answers, runs)


def _same(path: Path, known: str | None) -> None:
    if known is None and not path.exists():
        return
    if not path.exists() or digest(path) != known:
        raise BrokenSeal(f"{path}: is not the file that was committed")


def run(
    folder: Path,
    *,
    program: str = DIAGNOSIS,
    command: str | None = None,
    workers: int = 1,
    limit: float = 120.0,
    first: int | None = None,
    progress: Callable[[], object] = lambda: None,
) -> dict[str, Any]:
    """Let one program answer every case anew and commit its answers; those of others stay.

    program : name of the answers, which are in a folder of that name
    command : template with {cell}, {data}, {heldout} and {answer}, which are absolute paths; by
        default that of the diagnosis
    limit : s, for one case; first : how many cases, all without
    Returns what became of each case: "answered", "failed" or "too slow", and its seconds.
    """
    names = case_names(folder)[:first]
    parts = shlex.split(DIAGNOSE if command is None else command)
    answers = answers_folder(folder, program).resolve()
    (folder / "answers" / f"{program}.json").unlink(missing_ok=True)
    shutil.rmtree(answers, ignore_errors=True)
    answers.mkdir(parents=True)

    def one(name: str) -> dict[str, Any]:
        became = _answer((folder / "cases" / name).resolve(), answers, parts, limit)
        progress()
        return became

    with ThreadPoolExecutor(workers) as pool:
        runs = dict(zip(names, pool.map(one, names), strict=True))
    commit_answers(folder, runs, parts, program)
    return runs


def _answer(case: Path, answers: Path, parts: list[str], limit: float) -> dict[str, Any]:
    answer = answers / f"{case.name}.json"
    tables = {"data": case / "measurements.csv", "heldout": case / "heldout.csv"}
    command = [part.format(cell=case / "cell.toml", answer=answer, **tables) for part in parts]
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    begun = time.perf_counter()
    with answer.with_suffix(".log").open("wb") as log:
        try:
            done = subprocess.run(  # noqa: S603
                command, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                timeout=limit, env={**os.environ, **one_thread}, check=False,
            )  # fmt: skip
            status = "answered" if done.returncode == 0 and _readable(answer) else "failed"
        except subprocess.TimeoutExpired:
            status = "too slow"
    if status != "answered":
        answer.unlink(missing_ok=True)
    return {"status": status, "seconds": round(time.perf_counter() - begun, 3)}


def _readable(path: Path) -> bool:
    try:
        return isinstance(read_json(path), dict)
    except (OSError, ValueError):
        return False
