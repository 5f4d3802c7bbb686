"""Environments for the peers, their drivers run one after another, and the table of all."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.research.bench import Row, rms
from studies.research.benchmarks.peers.work import Work

HERE = Path(__file__).parent
INSTALL_S, RUN_S = 420.0, 240.0  # after which one is left out
REQUIRED = {
    "figaroh": "figaroh==1.0.2",
    "pybotics": "pybotics==3.1.2",
    "pydex": "pydex==0.0.9",
    "robotkinecal": "robotkinecal==0.1.0",
    "ros-industrial": "industrial-calibration",
}
OWN = ("posecal", "scipy")  # run by this interpreter


@dataclass(frozen=True)
class Left:
    """A program that was left out, and why."""

    name: str
    why: str

    def __str__(self) -> str:
        return f"{self.name}: left out, {self.why}"


def environment(folder: Path, name: str) -> Path | Left:
    """Interpreter of an environment that has the program, made where it does not stand yet."""
    where = (folder / name).resolve()
    python = where / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = where / "installed"
    wanted = REQUIRED[name]
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


def solved(python: str | Path, name: str, work: Work, repeats: int) -> dict[str, Any] | Left:
    """What a driver answers."""
    answer = work.folder / f"{name}.json"
    run = [str(python), str(HERE / f"drive_{name}.py"), str(work.folder), str(answer), str(repeats)]
    said = said_by(run, RUN_S, name)
    if isinstance(said, Left):
        return said
    found: dict[str, Any] = json.loads(answer.read_text())
    return found


def said_by(run: list[str], limit: float, name: str, folder: Path | None = None) -> str | Left:
    """What a program prints that ends well, on one thread, or why it is left out."""
    try:
        done = subprocess.run(  # noqa: S603
            run, capture_output=True, text=True, timeout=limit, cwd=folder, env=one_thread()
        )
    except subprocess.TimeoutExpired:
        return Left(name, f"not done after {limit:.0f} s")
    except OSError as error:
        return Left(name, str(error))
    if not done.returncode:
        return done.stdout
    return Left(name, (done.stderr.strip().splitlines() or ["no message"])[-1])


def rows_of(name: str, answer: dict[str, Any], work: Work) -> Iterator[Row]:
    """Figures of each run of a program."""
    for run in answer["runs"]:
        fit, held = work.errors_mm(run, "fit"), work.errors_mm(run, "heldout")
        yield {
            "program": f"{name} {answer['version']}",
            "way": run["way"] + ("" if run["converged"] else ", not converged"),
            "free": run["free"],
            "seconds": float(np.median(run["seconds"])),
            "runs": run["seconds"],
            "fitted [mm]": rms(fit),
            "held out, marker 1 [mm]": rms(held[:, 0]),
            "held out [mm]": rms(held) if held.shape[1] == work.heldout.shape[1] else None,
            "held out, median [mm]": float(np.median(held[:, 0])),
        }


def with_ratios(rows: Iterable[Row], to: Row) -> list[Row]:
    """Times as multiples of one row's: least over most, median over median, most over least."""
    own = np.array(to["runs"])
    return [
        {
            **row,
            "x posecal": [
                min(row["runs"]) / own.max(),
                row["seconds"] / np.median(own),
                max(row["runs"]) / own.min(),
            ],
        }
        for row in rows
    ]


def told(row: Row) -> Row:
    """A line of the table of programs that identify."""
    low, middle, high = row["x posecal"]
    kept = ("fitted [mm]", "held out [mm]", "held out, marker 1 [mm]", "held out, median [mm]")
    return {
        "program": row["program"],
        "way": row["way"],
        "free": row["free"],
        "CPU [s]": f"{row['seconds']:.3g}",
        "x posecal (spread)": f"{middle:.3g} ({low:.3g} to {high:.3g})",
        **{key: row[key] for key in kept},
    }


def one_thread() -> dict[str, str]:
    """The environment for peers, with one thread for their linear algebra."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    return {**os.environ, **dict.fromkeys(names, "1")}
