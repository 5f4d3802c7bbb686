"""DLR's humanoid Agile Justin: two arms of seven joints on one torso, a marker on each hand.

    python -m studies.research.benchmarks.justin [--days 0] [--model NAME ..] [--alone]
        [--plan [--match]]

The public table has 400 poses of both arms; every fifth one is held out, and nothing is fitted again on
it. Both arms are one robot with two tips. The torso's fourth joint has no drive: it is moved by the two
before it. ``--alone`` fits each arm as a chain of its own, which knows nothing of the other's weight.
``--days`` draws so many days from what was identified, with the noise found, and counts how often the
intervals of 95 % hold the truth. Published (Tenhumberg and Baeuml 2021), mean of all poses in mm: 21.33
nominal, 18.18 with offsets, 10.5 with DH parameters, 5.64 with joint compliances, 3.12 (8.23 at most)
with lateral ones.
``--plan`` plans forty poses for both arms, read by a tracker or watched from a head, and sets what the
plan promises beside simulated days; ``--match`` seeks how many planned poses tell as much as 500 at
random.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.poses import Measurements
from studies.research.bench import Output, Row, bench, count, several, table
from studies.research.benchmarks.justin import planned
from studies.research.benchmarks.justin.robot import SIDES, SIGMA_MM, alone, justin

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
_EVERY, _HELD = 5, 2


def split(data: Measurements) -> tuple[Measurements, Measurements]:
    """Those fitted, and every fifth one."""
    held = np.arange(len(data.poses)) % _EVERY == _HELD
    return data.take(~held), data.take(held)


def distances(found: calib.Identification, data: Measurements) -> Array:
    """Measured from predicted points, shape (m, M), mm; nothing fitted again."""
    return np.asarray(np.linalg.norm(found.model.off(found.values, data), axis=-1) * 1e3)


def fitted(
    cell: calib.Cell, data: Measurements, effects: Sequence[str]
) -> tuple[calib.Identification, Row]:
    """The fit of a model, and how far held-out points are from it."""
    train, held = split(data)
    begun = time.perf_counter()
    found = calib.identify(replace(cell, effects=tuple(effects)), train)
    seconds = time.perf_counter() - begun
    own, other = distances(found, train), distances(found, held)
    names = cell.marker_names
    by_hand = dict(zip(names, other.mean(axis=0).tolist(), strict=True))
    return found, {
        "parameters": found.choice.rank,
        "fitted_mean_mm": float(own.mean()),
        "mean_mm": float(other.mean()),
        "max_mm": float(other.max()),
        "by_hand_mm": by_hand,
        "seconds": seconds,
    }


def coverage(cell: calib.Cell, found: calib.Identification, data: Measurements, days: int) -> Row:
    """How often intervals of 95 % hold the truth on days drawn from an identification.

    cell : whose effects are those identified
    """
    model = found.model
    inside = []
    for day in range(days):
        rng = np.random.default_rng(day)
        readings = model.predict(found.values, data.poses)
        drawn = readings + rng.normal(size=readings.shape) * SIGMA_MM * 1e-3
        again = calib.identify(cell, replace(data, readings=drawn))
        told = {p.id: i for i, p in enumerate(again.model.parameters)}
        for p, truth in zip(model.parameters, found.values, strict=True):
            i = told.get(p.id)
            if i is not None and np.isfinite(again.std[i]) and again.std[i] > 0.0:
                inside.append(abs(again.values[i] - truth) < 1.96 * again.std[i])
    return {"days": days, "intervals": len(inside), "inside": float(np.mean(inside))}


def _turned(rows: Sequence[Row]) -> list[Row]:
    """A row of each figure, a column of each of these rows."""
    named = [str(row["instrument"]) for row in rows]
    return [
        {"": key, **dict(zip(named, (row[key] for row in rows), strict=True))} for key in rows[0]
    ]


@bench(
    count("--days", 0, least=0, help="Simulated days whose intervals are counted."),
    several("--model", tuple(MODELS), help="Models that are fitted."),
    click.option("--alone", "chains", is_flag=True, help="Each arm as a chain of its own, too."),
    click.option("--plan", is_flag=True, help="Plan days with the last model, and nothing else."),
    click.option("--match", is_flag=True, help="With --plan: plans like 500 poses at random."),
    count("--refits", 30, least=2, help="Simulated days of each plan."),
)
def main(
    seed: int,
    days: int,
    model: Sequence[str],
    chains: bool,
    plan: bool,
    match: bool,
    refits: int,
) -> Output:
    """Identify both arms of Agile Justin, model by model, and judge them on held-out poses."""
    if plan:
        rows = planned.rows(MODELS[model[-1]], refits, seed, match)
        return [table(_turned(rows))], {"plans": rows}
    cell, data = justin()
    rows = []
    last: Any = None
    for name in model:
        last, row = fitted(cell, data, MODELS[name])
        rows.append({"model": name, "arms": "both", "published": PUBLISHED.get(name), **row})
        for side in SIDES if chains else ():
            _, row = fitted(*alone(side), MODELS[name])
            rows.append({"model": name, "arms": f"{side} alone", "published": None, **row})
    shown = [
        {
            "mean distance, mm": row["model"],
            "arms": row["arms"],
            "published": row["published"],
            "held out": row["mean_mm"],
            "most": row["max_mm"],
            "fitted": row["fitted_mean_mm"],
            "parameters": row["parameters"],
            "seconds": row["seconds"],
        }
        for row in rows
    ]
    found: Row = {"models": rows}
    parts: list[Any] = [table(shown)]
    if days:
        known = replace(cell, effects=MODELS[model[-1]])
        found["intervals"] = coverage(known, last, split(data)[0], days)
        own = found["intervals"]
        parts.append(f"{own['inside']:.1%} of {own['intervals']} intervals hold the truth")
    return parts, found


if __name__ == "__main__":
    main()
