"""Cases are made and answered; keys are committed before, answers before a key is opened."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import numpy as np

from studies.research.sealed import draw, key

COMMITMENT = "commitment.json"
DIAGNOSE = (
    *(sys.executable, "-c", "from studies.cli import run; run()", "diagnose"),
    *("{cell}", "{data}", "--holdout", "{heldout}", "--json", "{answer}"),
)
"""``posecal diagnose CELL DATA --holdout HELDOUT --json ANSWER`` of the package that runs this."""


class BrokenSeal(Exception):
    """A file is not what was committed."""


@dataclass(frozen=True)
class Population:
    """Cases of one kind; shares : of its families."""

    shares: Mapping[str, float]
    draw: Callable[[np.random.Generator, str], draw.Case]


POPULATIONS = {
    "first": Population(draw.FIRST_SHARES, draw.draw_case),
    "arm_noise": Population(draw.FIRST_SHARES, draw.draw_noisy_case),
    "real_arms": Population(draw.REAL_SHARES, draw.draw_real_case),
    "foreign": Population(draw.FOREIGN_SHARES, draw.draw_foreign_case),
}
"""The first families; the same with arms that scatter; arms as real ones are; causes by
other formulas."""


def families(rng: np.random.Generator, count: int, shares: Mapping[str, float]) -> list[str]:
    """The family of each case: fixed shares in an order that tells nothing."""
    ends = np.round(np.cumsum([0.0, *shares.values()]) * count).astype(int)
    whole = [f for f, (a, b) in zip(shares, pairwise(ends), strict=True) for _ in range(b - a)]
    return [whole[i] for i in rng.permutation(count)]


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


def make(folder: Path, count: int, seed: int, population: str = "first") -> None:
    """Write cases of a population, keys, and last the commitment.

    Raises FileExistsError where the folder holds cases already.
    """
    if (folder / COMMITMENT).exists() or (folder / "cases").exists():
        raise FileExistsError(f"{folder}: holds cases already; name a new folder")
    (folder / "keys").mkdir(parents=True)
    own = POPULATIONS[population]
    drawn = families(np.random.default_rng([seed, count]), count, own.shares)
    with click.progressbar(drawn, file=sys.stderr, label="cases") as bar:
        for index, family in enumerate(bar):
            name = f"case_{index:04d}"
            # Each index has its own stream of random numbers.
            case = own.draw(np.random.default_rng([seed, index]), family)
            key.write_case(folder / "cases" / name, case)
            # The salt keeps the hash from being found by trying all that could have been drawn.
            head = {"schema": 1, "salt": secrets.token_hex(16), "case": name, "index": index}
            write_json(folder / "keys" / f"{name}.json", {**head, **key.key_of(case)})
    drawn_by = {} if population == "first" else {population: True}
    write_json(folder / "keys" / "seed.json", {"seed": seed, "count": count, **drawn_by})
    # Every key, and every file of every case so that none is exchanged.
    keys = {path.stem: digest(path) for path in sorted((folder / "keys").glob("case_*.json"))}
    paths = sorted((folder / "cases").glob("*/*"))
    files = {path.relative_to(folder / "cases").as_posix(): digest(path) for path in paths}
    write_json(folder / COMMITMENT, {"schema": 1, "keys": keys, "files": files})


def answer_of(folder: Path, name: str) -> Path:
    """Where the answer to a case is; the commitment to all of them is beside their folder."""
    return folder / "answers" / "diagnosis" / f"{name}.json"


def commit_answers(folder: Path, runs: dict[str, Any], command: Sequence[str]) -> None:
    """Hash every answer; a run that failed has none.

    The commitment to the keys is hashed too, so that answers belong to one set of keys.
    """
    for name, run in runs.items():
        path = answer_of(folder, name)
        run["sha256"] = digest(path) if path.exists() else None
    content = {"schema": 1, "command": command, "keys": digest(folder / COMMITMENT), "runs": runs}
    write_json(folder / "answers" / "diagnosis.json", content)


def opened(folder: Path) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Keys by case; the runs of all cases or of the first, and their answers, None where one failed.

    All answers are checked before any key is read. Raises BrokenSeal where answers were not committed,
    or anything differs from what was.
    """
    if not (folder / COMMITMENT).exists():
        raise BrokenSeal(f"{folder}: holds no sealed cases; make them first")
    if not (folder / "answers" / "diagnosis.json").exists():
        raise BrokenSeal(f"{folder}: answers are not committed; run the diagnosis first")
    committed = read_json(folder / "answers" / "diagnosis.json")
    if committed["keys"] != digest(folder / COMMITMENT):
        raise BrokenSeal(f"{folder / COMMITMENT}: changed after the answers were committed")
    runs, answers = committed["runs"], dict[str, Any]()
    if sorted(runs) != case_names(folder)[: len(runs)]:
        raise BrokenSeal(f"{folder}: answers are of chosen cases; all of them, or the first, count")
    for name, run in runs.items():
        _same(answer_of(folder, name), run["sha256"])
        answers[name] = read_json(answer_of(folder, name)) if run["sha256"] else None
    commitment = read_json(folder / COMMITMENT)
    for name, known in commitment["files"].items():
        _same(folder / "cases" / name, known)
    for name, known in commitment["keys"].items():
        _same(folder / "keys" / f"{name}.json", known)
    keys = {name: read_json(folder / "keys" / f"{name}.json") for name in commitment["keys"]}
    return keys, runs, answers


def _same(path: Path, known: str | None) -> None:
    if (digest(path) if path.exists() else None) != known:
        raise BrokenSeal(f"{path}: is not the file that was committed")


def run(
    folder: Path,
    *,
    command: Sequence[str] = DIAGNOSE,
    workers: int = 1,
    limit: float = 120.0,
    first: int | None = None,
) -> dict[str, Any]:
    """Let the diagnosis answer every case anew, and commit the answers.

    command : words with {cell}, {data}, {heldout} and {answer}, which are absolute paths
    limit : s, for one case; first : how many cases, all without
    Returns what became of each case: "answered", "failed" or "too slow", and its seconds.
    """
    names, answers = case_names(folder)[:first], answer_of(folder, "").parent
    (folder / "answers" / "diagnosis.json").unlink(missing_ok=True)
    shutil.rmtree(answers, ignore_errors=True)
    answers.mkdir(parents=True)

    def one(name: str) -> dict[str, Any]:
        case, answer = (folder / "cases" / name).resolve(), answer_of(folder, name).resolve()
        return _answered(case, answer, command, limit)

    bar = click.progressbar(length=len(names), file=sys.stderr, label="answers")
    runs = {}
    with bar, ThreadPoolExecutor(workers) as pool:
        for name, became in zip(names, pool.map(one, names), strict=True):
            runs[name] = became
            bar.update(1)
    commit_answers(folder, runs, command)
    return runs


def _answered(case: Path, answer: Path, command: Sequence[str], limit: float) -> dict[str, Any]:
    tables = {"data": case / "measurements.csv", "heldout": case / "heldout.csv"}
    words = [word.format(cell=case / "cell.toml", answer=answer, **tables) for word in command]
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    begun = time.perf_counter()
    with answer.with_suffix(".log").open("wb") as log:
        try:
            done = subprocess.run(  # noqa: S603
                words, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
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
