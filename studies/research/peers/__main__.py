"""posecal beside other programs: each in an environment of its own, all at the same work.

    python -m studies.research.peers FOLDER [--repeats 3] [--json FILE]

Every other program is installed below FOLDER by pip. 100 of 700 poses of a real arm are to be fitted,
the others predicted. What does not install is left out and said. Times are CPU seconds of one thread.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np

from calib.errors import CalibError
from studies.research.bench import Output, Row, bench, count, rms, table
from studies.research.peers.run import Left, environments, solved
from studies.research.peers.work import Work, write_work

OWN = ("posecal", "scipy")  # run by this interpreter
_SHOWN = ("program", "way", "free", "seconds", "x posecal", "fitted [mm]", "held out [mm]")


@bench(
    click.argument("folder", type=click.Path(path_type=Path, file_okay=False)),
    count("--repeats", 3, help="Runs of which the median counts."),
)
def main(folder: Path, repeats: int, seed: int) -> Output:
    """Set posecal and other programs the same work."""
    del seed
    folder.mkdir(parents=True, exist_ok=True)
    pythons, skipped = environments(folder)
    work = write_work(folder / "work")
    rows: list[Row] = []
    for name in (*OWN, *pythons):
        answer = solved(pythons.get(name, Path(sys.executable)), name, work.folder, repeats)
        if isinstance(answer, Left):
            skipped.append(str(answer))
        else:
            rows += rows_of(name, answer, work)
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


if __name__ == "__main__":
    main()
