"""How often a diagnosis stays what it is where nothing of the day changes.

    python -m studies.research.benchmarks.invariance [--days 40] [--splits 5] [--workers 2]

Each day is diagnosed as it is, with 1e-15 m (or as much of another unit) of noise more, and with its
rows in another order that their own columns of order and time tell. Days are drawn as sealed cases are;
real sets are split by seeds, 60 poses of each. Counted are days whose causes and verdict are the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
from calib import Cell, Measurements
from studies.research.bench import Output, Row, bench, count, data_folder, each, real_data, table
from studies.research.withheld.make import POPULATIONS, families

ROUNDING, POSES = 1e-15, 60
_SHARED = 40  # days among which families are shared out
CHANGES = ("rounding", "shuffled")


def changed(data: Measurements, seed: int) -> Iterator[tuple[str, Measurements]]:
    """The day with nothing changed that means anything."""
    rng = np.random.default_rng(seed)
    noise = ROUNDING * rng.normal(size=data.readings.shape) * data.seen[..., None]
    yield "rounding", replace(data, readings=data.readings + noise)
    yield "shuffled", data.take(rng.permutation(len(data)))


def answer(cell: Cell, data: Measurements) -> tuple[str, tuple[str, ...]]:
    """Verdict, and the causes in the order of their names."""
    found = calib.diagnose(cell, data)
    return found.verdict, tuple(sorted(c.named.candidate.key for c in found.causes))


def one_day(kind: str, index: int, seed: int) -> Row:
    """Answers to a day and to its likes; kind : of sealed cases, or the name of a real set."""
    with TemporaryDirectory() as folder:
        if kind in POPULATIONS:
            own = POPULATIONS[kind]
            family = families(np.random.default_rng(seed), _SHARED, own.shares)[index % _SHARED]
            case = Path(folder) / "case"
            own.write(case, own.draw(np.random.default_rng([seed, index]), family))
            cell = calib.load_cell(case / "cell.toml")
            data = calib.load_measurements(cell, case / "measurements.csv")
        else:
            cell, data = real_data(kind)
            kept = np.random.default_rng([seed, index]).permutation(len(data))[:POSES]
            data = data.take(np.sort(kept))
        found = {"as it is": answer(cell, data)}
        found |= {name: answer(cell, own) for name, own in changed(data, index)}
    return {"kind": kind, "index": index, **found}


@bench(count("--splits", 5, help="Of each real set."), days=40, workers=True)
def main(splits: int, days: int, seed: int, workers: int) -> Output:
    """Diagnose days again in which nothing changes."""
    real = [p.parent.name for p in sorted(data_folder("").glob("*/measurements.csv"))]
    drawn = ["first", "real_arms"]
    tasks = [(kind, i) for i in range(days // len(drawn)) for kind in drawn]
    tasks += [(name, i) for name in real for i in range(splits)]
    found = each(one_day, tasks, workers, seed=seed)
    same = {
        name: Counter(row["kind"] for row in found if row[name] == row["as it is"])
        for name in CHANGES
    }
    total = Counter(row["kind"] for row in found)
    rows = [
        {"days": kind, "of": n, **{name: same[name][kind] for name in CHANGES}}
        for kind, n in total.items()
    ]
    whole = {"days": "all", "of": len(found)}
    rows.append(whole | {name: same[name].total() for name in CHANGES})
    unlike = [row for row in found if any(row[name] != row["as it is"] for name in CHANGES)]
    return [table(rows), *(_told(row) for row in unlike)], found


def _told(row: Row) -> str:
    lines = [
        f"{name:9} {verdict}: {', '.join(causes) or 'nothing'}"
        for name, (verdict, causes) in ((name, row[name]) for name in ("as it is", *CHANGES))
    ]
    return "\n  ".join([f"{row['kind']} {row['index']}", *lines])


if __name__ == "__main__":
    main()
