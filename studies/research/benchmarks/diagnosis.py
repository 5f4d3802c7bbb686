"""The diagnosis of real measurements: what is named, located and left over, and what it takes.

    python -m studies.research.benchmarks.diagnosis [FOLDER ...] [--splits 10] [--workers 2]
        [--json FILE]

FOLDER holds ``cell.toml`` and ``measurements.csv``; without one, every set under ``POSECAL_DATA``.
Each is diagnosed with three tenths of its configurations held out, drawn by seeds 0, 1, .. Held-out
errors count every pose. "not worse" counts the splits whose held-out error did not rise; "named" and
"located" say in how many splits. Seconds are those of the processor, with one thread of linear algebra.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import click
import numpy as np

import calib
from calib.diagnosis.diagnose import diagnose
from calib.files.write import json_text, write_files
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.diagnose import make
from studies.tables import plain_table

HELD_OUT = 0.3
_SHOWN = 4
_HEADINGS = (
    ("\ndata", "left"), ("poses\nfitted", "right"), ("held out [mm]\nbefore", "right"),
    ("\nafter", "right"), ("\nworst split", "right"), ("\nfloor", "right"),
    ("\nnot worse", "right"), ("\n[s]", "right"),
)  # fmt: skip


def one_split(folder: Path, seed: int) -> dict[str, Any]:
    """Diagnosis of one split: the fields of ``diagnose --json``, with seconds and poses."""
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    kept, held = data.split(HELD_OUT, np.random.default_rng(seed))
    begun = time.process_time()
    found = make.findings(diagnose(cell, kept, heldout=held)).model_dump(by_alias=True)
    return {**found, "seconds": time.process_time() - begun, "poses": len(kept), "seed": seed}


def row(name: str, splits: list[dict[str, Any]]) -> list[str]:
    """Medians over the splits of one set."""
    gaps = [s["gap"] for s in splits]
    before = np.array([g["heldout_before_mm"] for g in gaps])
    after = np.array([g["heldout_after_mm"] for g in gaps])
    worst = int(np.argmax(after / before))
    return [
        name,
        f"{np.median([s['poses'] for s in splits]):.0f}",
        f"{np.median(before):.3f}",
        f"{np.median(after):.3f}",
        f"{before[worst]:.3f} to {after[worst]:.3f}",
        f"{np.median([g['floor_mm'] for g in gaps]):.3f}",
        f"{np.count_nonzero(after <= before)} of {len(splits)}",
        f"{np.median([s['seconds'] for s in splits]):.1f}",
    ]


def findings(splits: list[dict[str, Any]]) -> tuple[str, str]:
    """What was named, and what was located without a name, in how many splits."""
    names = Counter(f"{e['effect']}:{e['where']}" for s in splits for e in s["effects"])
    places: Counter[str] = Counter()
    for split in splits:
        named = {e["where"] for e in split["effects"]}
        places.update(
            {
                f"{p['where']} by {p['depends_on']}"
                for p in split["located"]
                if p["where"] not in named
            }
        )
    return _listed(names), _listed(places)


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in counts.most_common(_SHOWN)) or "nothing"


def real_sets() -> list[Path]:
    """Folders of measurements under ``POSECAL_DATA``."""
    root = os.environ.get("POSECAL_DATA")
    if root is None:
        raise click.UsageError("name a FOLDER, or set POSECAL_DATA")
    return sorted(path.parent for path in Path(root).glob("*/measurements.csv"))


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--splits", type=click.IntRange(min=1), default=10, show_default=True)
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All diagnoses.")
@one_line_faults
def main(folders: tuple[Path, ...], splits: int, workers: int, json_path: Path | None) -> None:
    """Diagnose real measurements at several splits and print what became of them."""
    found: dict[str, list[dict[str, Any]]] = {}
    with ProcessPoolExecutor(workers) as pool:
        for folder in folders or real_sets():
            found[folder.name] = list(pool.map(one_split, [folder] * splits, range(splits)))
    console = console_for(None)
    table = plain_table(*_HEADINGS)
    for name, runs in found.items():
        table.add_row(*row(name, runs))
    console.print(table)
    for name, runs in found.items():
        named, located = findings(runs)
        console.print(f"{name}\n  named    {named}\n  located  {located}")
    if json_path is not None:
        write_files({json_path: json_text(found)})


if __name__ == "__main__":
    main()
