"""posecal beside other programs: each in an environment of its own, all at the same work.

    python -m studies.research.peers FOLDER [--repeats 3] [--json FILE]

Every other program is installed below FOLDER by pip. 100 of 700 poses of a real arm are to be fitted,
the others predicted. What does not install is left out and said. Times are CPU seconds of one thread.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import click
import numpy as np

from calib.errors import CalibError
from studies.research.bench import Output, Row, bench, count, rms, table
from studies.research.peers.work import Work, write_work

HERE = Path(__file__).parent
INSTALL_S, RUN_S = 420.0, 240.0  # after which one is left out
PROGRAMS = {"posecal": "", "figaroh": "figaroh==1.0.2"}
"""What each needs beside this interpreter."""
_SHOWN = ("program", "way", "free", "seconds", "x posecal", "fitted [mm]", "held out [mm]")


class LeftOut(Exception):
    """A program was left out, and why."""


@bench(
    click.argument("folder", type=click.Path(path_type=Path, file_okay=False)),
    count("--repeats", 3, help="Runs of which the median counts."),
)
def main(folder: Path, repeats: int, seed: int) -> Output:
    """Set posecal and other programs the same work."""
    del seed
    work = write_work(folder / "work")
    rows: list[Row] = []
    skipped = []
    for name, wanted in PROGRAMS.items():
        try:
            python = environment((folder / name).resolve(), wanted)
            rows += rows_of(name, solved(python, name, work.folder, repeats), work)
        except LeftOut as why:
            skipped.append(f"{name}: left out, {why}")
    if not rows or not rows[0]["program"].startswith("posecal"):
        raise CalibError("posecal itself did not answer: " + "; ".join(skipped))
    for row in rows:
        row["x posecal"] = row["seconds"] / rows[0]["seconds"]
    fits = ({key: row[key] for key in _SHOWN} for row in rows)
    return [table(fits), *skipped], {"identification": rows}


def rows_of(name: str, answer: Row, work: Work) -> list[Row]:
    """Figures of each run of a program."""
    return [
        {
            "program": f"{name} {answer['version']}",
            "way": run["way"] + ("" if run["converged"] else ", not converged"),
            "free": run["free"],
            "seconds": float(np.median(run["seconds"])),
            "runs": run["seconds"],
            "fitted [mm]": rms(work.errors_mm(run, "fit")),
            "held out [mm]": rms(work.errors_mm(run, "heldout")),
        }
        for run in answer["runs"]
    ]


def environment(where: Path, wanted: str) -> Path:
    """Interpreter of an environment that has a program, made where there is none yet."""
    if not wanted:
        return Path(sys.executable)
    python = where / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = where / "installed"
    if not done.exists() or done.read_text() != wanted:
        said_by([sys.executable, "-m", "venv", str(where)], INSTALL_S)
        # Not from source: a build that works today says little about tomorrow.
        pip = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
        said_by([*pip, "--prefer-binary", *wanted.split()], INSTALL_S)
        done.write_text(wanted)
    return python


def solved(python: Path, name: str, folder: Path, repeats: int) -> Row:
    """What a driver answers to the work in a folder."""
    answer = folder / f"{name}.json"
    said_by(
        [str(python), str(HERE / f"drive_{name}.py"), str(folder), str(answer), str(repeats)], RUN_S
    )
    found: Row = json.loads(answer.read_text())
    return found


def said_by(run: list[str], limit: float) -> None:
    """Run a program on one thread. Raises LeftOut where it does not end well."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    env = {**os.environ, **dict.fromkeys(names, "1")}
    try:
        done = subprocess.run(  # noqa: S603
            run, capture_output=True, text=True, timeout=limit, env=env
        )
    except subprocess.TimeoutExpired:
        raise LeftOut(f"not done after {limit:.0f} s") from None
    except OSError as error:
        raise LeftOut(str(error)) from None
    if done.returncode:
        raise LeftOut((done.stderr.strip().splitlines() or ["no message"])[-1])


if __name__ == "__main__":
    main()
