"""Environments for the peers, and their drivers run one after another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
INSTALL_S, RUN_S = 420.0, 240.0  # after which one is left out
REQUIRED = {"figaroh": "figaroh==1.0.2"}


@dataclass(frozen=True)
class Left:
    """A program that was left out, and why."""

    name: str
    why: str

    def __str__(self) -> str:
        return f"{self.name}: left out, {self.why}"


def environments(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """An interpreter for each program that installs; a line for each that does not."""
    made = {name: environment(folder, name) for name in REQUIRED}
    left = [str(own) for own in made.values() if isinstance(own, Left)]
    return {name: python for name, python in made.items() if isinstance(python, Path)}, left


def environment(folder: Path, name: str) -> Path | Left:
    """Interpreter of an environment that has the program, made where there is none yet."""
    where = (folder / name).resolve()
    python = where / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done, wanted = where / "installed", REQUIRED[name]
    if done.exists() and done.read_text() == wanted:
        return python
    # Not from source: a build that works today says little about tomorrow.
    pip = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    for run in ([sys.executable, "-m", "venv", str(where)], [*pip, "--prefer-binary", wanted]):
        made = said_by(run, INSTALL_S, name)
        if isinstance(made, Left):
            return made
    done.write_text(wanted)
    return python


def solved(python: Path, name: str, folder: Path, repeats: int) -> dict[str, Any] | Left:
    """What a driver answers to the work in a folder."""
    answer = folder / f"{name}.json"
    run = [str(python), str(HERE / f"drive_{name}.py"), str(folder), str(answer), str(repeats)]
    said = said_by(run, RUN_S, name)
    if isinstance(said, Left):
        return said
    found: dict[str, Any] = json.loads(answer.read_text())
    return found


def said_by(run: list[str], limit: float, name: str) -> str | Left:
    """What a program prints that ends well, on one thread, or why it is left out."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    env = {**os.environ, **dict.fromkeys(names, "1")}
    try:
        done = subprocess.run(  # noqa: S603
            run, capture_output=True, text=True, timeout=limit, env=env
        )
    except subprocess.TimeoutExpired:
        return Left(name, f"not done after {limit:.0f} s")
    except OSError as error:
        return Left(name, str(error))
    if not done.returncode:
        return done.stdout
    return Left(name, (done.stderr.strip().splitlines() or ["no message"])[-1])
