"""DLR's humanoid Agile Justin: two arms of seven joints on one torso, a marker on each hand.

    python -m studies.research.benchmarks.justin [--model NAME ..] [--alone] [--write FOLDER]

The public table has 400 poses of both arms; each fifth of them is held out in turn, and nothing is
fitted again on it. Both arms are one robot with two tips. The torso's fourth joint has no drive: it is
moved by the two before it. ``--alone`` fits each arm as a chain of its own, which knows nothing of the
other's weight. Published (Tenhumberg and Baeuml 2021) are means of all 500 poses, mm. ``--write`` only
writes cell and table, with the last model, for ``posecal diagnose``.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.poses import Measurements
from studies.research.bench import Output, Row, bench, several, table
from studies.research.benchmarks.justin.robot import SIDES, alone, justin, write

_GEOMETRY = ("base", "tool", "geometry")
_SOFT = ("joint_compliance", "bearing_compliance", "base_compliance")
MODELS: Mapping[str, tuple[str, ...]] = {
    "base and markers": ("base", "tool"),
    "joint offsets": ("base", "tool", "joint_offset"),
    "geometry": _GEOMETRY,
    "+ joint compliance": (*_GEOMETRY, "joint_compliance"),
    "+ lateral compliance": (*_GEOMETRY, "joint_compliance", "bearing_compliance"),
    "+ a base that tilts": (*_GEOMETRY, *_SOFT),
    "+ gear ratios": (*_GEOMETRY, *_SOFT, "transmission_scale"),
}
PUBLISHED = dict(zip(MODELS, (21.33, 18.18, 10.5, 5.64, 3.12), strict=False))
_FOLDS = 5


def folds(data: Measurements) -> Iterator[tuple[Measurements, Measurements]]:
    """Those fitted, and every fifth pose; each pose is held out once."""
    for fold in range(_FOLDS):
        held = np.arange(len(data.poses)) % _FOLDS == fold
        yield data.take(~held), data.take(held)


def distances(found: calib.Identification, data: Measurements) -> Array:
    """Measured from predicted points, shape (m, M), mm; nothing fitted again."""
    return np.asarray(np.linalg.norm(found.model.off(found.values, data), axis=-1) * 1e3)


def fitted(cell: calib.Cell, data: Measurements, effects: Sequence[str]) -> Row:
    """How far a model is from points that took part in its fits, and from points that did not."""
    cell = replace(cell, effects=tuple(effects))
    own, other, rank = [], [], 0
    begun = time.perf_counter()
    for train, held in folds(data):
        found = calib.identify(cell, train)
        rank = found.choice.rank
        own.append(distances(found, train))
        other.append(distances(found, held))
    apart = np.concatenate(other)
    names = cell.marker_names
    return {
        "parameters": rank,
        "fitted_mean_mm": float(np.concatenate(own).mean()),
        "mean_mm": float(apart.mean()),
        "folds_mm": [float(part.mean()) for part in other],
        "largest_mm": np.sort(apart, axis=None)[:-4:-1].tolist(),
        "by_hand_mm": dict(zip(names, apart.mean(axis=0).tolist(), strict=True)),
        "seconds": (time.perf_counter() - begun) / _FOLDS,
    }


@bench(
    several("--model", tuple(MODELS), help="Models that are fitted."),
    click.option("--alone", "chains", is_flag=True, help="Each arm as a chain of its own, too."),
    click.option(
        "--write",
        "folder",
        type=click.Path(file_okay=False, path_type=Path),
        help="Write cell and table there, and nothing else.",
    ),
)
def main(
    seed: int,
    model: Sequence[str],
    chains: bool,
    folder: Path | None,
) -> Output:
    """Identify both arms of Agile Justin, model by model, and judge them on held-out poses."""
    del seed
    if folder is not None:
        return [f"wrote {write(folder, MODELS[model[-1]])}"], {}
    cell, data = justin()
    rows = []
    for name in model:
        row = fitted(cell, data, MODELS[name])
        rows.append({"model": name, "arms": "both", "published": PUBLISHED.get(name), **row})
        for side in SIDES if chains else ():
            row = fitted(*alone(side), MODELS[name])
            rows.append({"model": name, "arms": f"{side} alone", "published": None, **row})
    shown = [
        {
            "mean distance, mm": row["model"],
            "arms": row["arms"],
            "published": row["published"],
            "held out": row["mean_mm"],
            "by fold": f"{min(row['folds_mm']):.2f} to {max(row['folds_mm']):.2f}",
            "largest": " ".join(f"{most:.1f}" for most in row["largest_mm"]),
            "fitted": row["fitted_mean_mm"],
            "parameters": row["parameters"],
            "seconds": row["seconds"],
        }
        for row in rows
    ]
    return [table(shown)], {"models": rows}


if __name__ == "__main__":
    main()
