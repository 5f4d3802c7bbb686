"""The diagnosis of real measurements: what is named, located and left over, and what it takes.

    python -m studies.research.benchmarks.diagnosis [FOLDER ...] [--splits 10] [--workers 2]
        [--json FILE]

FOLDER holds ``cell.toml`` and ``measurements.csv``; without one, every set under ``POSECAL_DATA``.
Each is diagnosed with three tenths of its configurations held out, drawn by seeds 0, 1, .. Held-out
errors count every pose. "not worse" counts the splits whose held-out error did not rise; "named" and
"located" say in how many splits. Seconds are those of the processor, with one thread of linear algebra.
"""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import click
import numpy as np

import calib
from calib.diagnosis.diagnose import diagnose
from studies.diagnose.make import diagnose_record
from studies.record import envelope
from studies.research.bench import Output, Row, bench, clocked, count, data_folder, each, table

HELD_OUT = 0.3
_SHOWN = 4


def one_split(folder: Path, seed: int) -> Row:
    """Diagnosis of one split: the fields of ``diagnose --json``, with seconds and poses."""
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    kept, held = data.split(HELD_OUT, np.random.default_rng(seed))
    made_from = envelope(cell.name, [])
    found, seconds = clocked(lambda: diagnose_record(diagnose(cell, kept, heldout=held), made_from))
    told = found.model_dump(by_alias=True, exclude={"estimate"})
    return {**told, "seconds": seconds, "poses": len(kept), "seed": seed}


def row(name: str, splits: list[Row]) -> Row:
    """Medians over the splits of one set."""
    gaps = [s["gap"] for s in splits]
    before = np.array([g["heldout_before_mm"] for g in gaps])
    after = np.array([g["heldout_after_mm"] for g in gaps])
    worst = int(np.argmax(after / before))
    return {
        "data": name,
        "poses\nfitted": f"{np.median([s['poses'] for s in splits]):.0f}",
        "held out [mm]\nbefore": f"{np.median(before):.3f}",
        "after": f"{np.median(after):.3f}",
        "worst split": f"{before[worst]:.3f} to {after[worst]:.3f}",
        "floor": f"{np.median([g['floor_mm'] for g in gaps]):.3f}",
        "not worse": f"{np.count_nonzero(after <= before)} of {len(splits)}",
        "[s]": f"{np.median([s['seconds'] for s in splits]):.1f}",
    }


def findings(name: str, splits: list[Row]) -> str:
    """What was named, and what was located without a name, in how many splits."""
    names = Counter(f"{e['effect']}:{e['where']}" for s in splits for e in s["effects"])
    places: Counter[str] = Counter()
    for split in splits:
        named = {e["where"] for e in split["effects"]}
        found = {(p["where"], p["depends_on"]) for p in split["located"] if p["where"] not in named}
        places.update(f"{where} by {by}" for where, by in found)
    return f"{name}\n  named    {_listed(names)}\n  located  {_listed(places)}"


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in counts.most_common(_SHOWN)) or "nothing"


@bench(
    click.argument(
        "folders", nargs=-1, type=click.Path(path_type=Path, exists=True, file_okay=False)
    ),
    count("--splits", 10),
    workers=True,
)
def main(folders: tuple[Path, ...], splits: int, seed: int, workers: int) -> Output:
    """Diagnose real measurements at several splits."""
    folders = folders or tuple(p.parent for p in sorted(data_folder().glob("*/measurements.csv")))
    runs = each(one_split, product(folders, range(seed, seed + splits)), workers)
    found = {f.name: runs[splits * i : splits * (i + 1)] for i, f in enumerate(folders)}
    told = [findings(name, own) for name, own in found.items()]
    return [table(row(name, own) for name, own in found.items()), *told], found


if __name__ == "__main__":
    main()
