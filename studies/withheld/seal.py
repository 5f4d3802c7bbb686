"""Commitments: hashes of keys before the diagnosis runs, of answers before the keys are opened."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

COMMITMENT = "commitment.json"
ANSWERS = "answers.json"


class BrokenSeal(Exception):
    """A file is not what was committed."""


def digest(path: Path) -> str:
    """sha256 of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_json(path: Path, content: Any) -> None:
    """Write JSON without NaN, whole or not at all."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    draft = path.with_name(path.name + ".part")
    draft.write_text(text, encoding="utf-8", newline="\n")
    draft.replace(path)


def read_json(path: Path) -> Any:
    """Read JSON."""
    return json.loads(path.read_text(encoding="utf-8"))


def case_names(folder: Path) -> list[str]:
    """Names of the cases that were committed."""
    return sorted(read_json(folder / COMMITMENT)["keys"])


def commit_keys(folder: Path) -> None:
    """Hash every key, and every file of every case so that none is exchanged."""
    keys = {path.stem: digest(path) for path in sorted((folder / "keys").glob("case_*.json"))}
    files = {
        path.relative_to(folder / "cases").as_posix(): digest(path)
        for path in sorted((folder / "cases").glob("*/*"))
    }
    write_json(folder / COMMITMENT, {"schema": 1, "keys": keys, "files": files})


def commit_answers(folder: Path, runs: dict[str, Any], command: list[str]) -> None:
    """Hash every answer; a run that failed has none.

    The commitment to the keys is hashed too, so that answers belong to one set of keys.
    """
    for name, run in runs.items():
        path = folder / "answers" / f"{name}.json"
        run["sha256"] = digest(path) if path.exists() else None
    content = {"schema": 1, "command": command, "keys": digest(folder / COMMITMENT), "runs": runs}
    write_json(folder / ANSWERS, content)


def opened(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Keys and answers by case, None for a run that failed; answers are checked before any key is read.

    Raises BrokenSeal where answers were not committed, or anything differs from what was.
    """
    if not (folder / ANSWERS).exists():
        raise BrokenSeal(f"{folder / ANSWERS}: answers are not committed; run the diagnosis first")
    committed = read_json(folder / ANSWERS)
    if committed["keys"] != digest(folder / COMMITMENT):
        raise BrokenSeal(f"{folder / COMMITMENT}: changed after the answers were committed")
    answers: dict[str, Any] = {}
    for name, run in committed["runs"].items():
        path = folder / "answers" / f"{name}.json"
        _same(path, run["sha256"])
        answers[name] = read_json(path) if run["sha256"] else None
    commitment = read_json(folder / COMMITMENT)
    for name, known in commitment["files"].items():
        _same(folder / "cases" / name, known)
    keys = {}
    for name, known in commitment["keys"].items():
        path = folder / "keys" / f"{name}.json"
        _same(path, known)
        keys[name] = read_json(path)
    return keys, {name: answers.get(name) for name in keys}


def _same(path: Path, known: str | None) -> None:
    if known is None and not path.exists():
        return
    if not path.exists() or digest(path) != known:
        raise BrokenSeal(f"{path}: is not the file that was committed")
