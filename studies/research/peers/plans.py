"""posecal's plans beside FIGAROH's Detmax and a plain exchange: the same random problems.

    python -m studies.research.peers.plans FOLDER [--problems 4] [--json FILE]

The problems are those of ``N.plans`` whose criterion is D. Seconds are CPU of one thread; those of
posecal hold the relaxation that its proof needs. Detmax starts three times at random, its best plan
counts, and its seconds are those of all starts. Values and times are multiples of posecal's.
"""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np

from studies.research.bench import Output, Row, bench, count, each, table
from studies.research.peers.__main__ import PROGRAMS, environment, said_by
from studies.research.plans import CRITERIA, Plain, draw, one

_STARTS = 10  # of the plain exchange
_LIMIT = 1200.0  # s, for Detmax on all problems


@bench(
    click.argument("folder", type=click.Path(path_type=Path, file_okay=False)),
    count("--problems", 4),
)
def main(folder: Path, problems: int, seed: int) -> Output:
    """Set posecal and other programs the same problems."""
    indices = [k * len(CRITERIA) + CRITERIA.index("D") for k in range(problems)]
    rows = each(one, [(index,) for index in indices], seed=seed, starts=_STARTS)
    for row, runs in zip(rows, _detmax(folder, indices, seed), strict=True):
        row["plain [x]"], row["plain, time [x]"] = (
            1.0 / (1.0 + row.pop("gain")),
            row.pop("plain [s]"),
        )
        own = row.pop("relax [s]") + row.pop("search [s]")
        row["plain, time [x]"] /= own
        row["Detmax [x]"] = max(run["value"] for run in runs) / row["value"]
        row["Detmax, time [x]"] = sum(run["seconds"] for run in runs) / own
    return [table(rows)], {"seed": seed, "problems": rows}


def _detmax(folder: Path, indices: list[int], seed: int) -> list[list[Row]]:
    """Runs of each problem: their CPU seconds and the value of the plan."""
    folder.mkdir(parents=True, exist_ok=True)
    python = environment((folder / "figaroh").resolve(), PROGRAMS["figaroh"])
    drawn = {str(index): draw(index, seed) for index in indices}
    work, answer = folder / "problems.npz", folder / "plans.json"
    arrays: Row = {name: np.swapaxes(own.rows, 1, 2) @ own.rows for name, own in drawn.items()}
    arrays |= {f"{name}_poses": np.array(own.poses) for name, own in drawn.items()}
    np.savez(work, **arrays)
    driver = Path(__file__).with_name("drive_figaroh_plans.py")
    said_by([str(python), "-P", str(driver), str(work), str(answer)], _LIMIT)
    runs = json.loads(answer.read_text())["runs"]
    found = []
    for name, own in drawn.items():
        value = Plain(own).value
        mine = [run for run in runs if run["problem"] == name]
        found.append([{**run, "value": value(np.array(run["plan"]))} for run in mine])
    return found


if __name__ == "__main__":
    main()
