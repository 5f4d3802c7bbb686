"""Held-out errors of each estimator, and how many intervals of parameters hold, over all days."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

import calib
from calib.arrays import Array
from calib.model.build import build
from studies.research.bench import Row
from studies.research.benchmarks.few_poses.day import DEFAULT, Day, exact_values, table_of

_LARGEST_RESIDUAL = 1e-9  # m, of exact readings
_COVERED = (10, 15, 20, 40)  # poses at which coverage is told


def true_values(cell: calib.Cell, day: Day) -> Array:
    """What the model's parameters are of this arm, shape (p,), SI, by exact readings of other poses.

    Raises RuntimeError where the model cannot stand for the arm.
    """
    exact = table_of(day.held, day.points(day.held))
    values, left = exact_values(build(cell, exact.poses).model, exact)
    if left > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {left} m: no truth to measure against")
    return values


def held_of(found: calib.Identification, truth: Array) -> Row:
    """How many 95 % intervals of estimated parameters hold the truth (p,)."""
    low, high = found.interval().T
    estimated = np.diag(found.covariance) > 0.0
    holds = ((low <= truth) & (truth <= high))[estimated]
    return {"held": int(np.count_nonzero(holds)), "of": int(holds.size)}


def errors_table(rows: Sequence[Row]) -> Iterator[Row]:
    """One line for each size of errors, number of markers and of poses, and estimator."""
    for (times, markers, poses), own in _groups(rows, "times", "markers", "poses"):
        for way, found in errors_of(own).items():
            yield {
                "errors": f"{times:g} x", "markers": markers, "poses": poses, "estimator": way,
                "days": found["days"], "no\nanswer": found["silent"],
                "mean\n[mm]": found["mean_mm"], "mean /\nposecal's": found["mean_ratio"],
            }  # fmt: skip


def errors_of(rows: Sequence[Row]) -> dict[str, Row]:
    """Of each estimator, over tables of one kind; the ratio over the days on which both answer."""
    found: dict[str, Row] = {}
    for way in dict.fromkeys(way for r in rows for way in r["errors_m"]):
        own = [r["errors_m"][way] for r in rows]
        told = [e for e in own if e is not None]
        pairs = [(e, r["errors_m"][DEFAULT]) for e, r in zip(own, rows, strict=True)]
        theirs, posecals = np.array([p for p in pairs if None not in p]).reshape(-1, 2).T
        found[way] = {
            "days": len(own),
            "silent": len(own) - len(told),
            "mean_mm": float(np.mean(told)) * 1e3 if told else None,
            "mean_ratio": float(theirs.mean() / posecals.mean()) if len(theirs) else None,
        }
    return found


def coverage_table(rows: Sequence[Row]) -> Iterator[Row]:
    """One line for each size of errors, arm that scatters or not, number of poses, and way.

    The share of parameters' intervals that hold.
    """
    covered = [r for r in rows if r["poses"] in _COVERED]
    for (times, scatters, poses), own in _groups(covered, "times", "scatters", "poses"):
        for way in dict.fromkeys(way for r in own for way in r["intervals"]):
            days = [r["intervals"][way] for r in own if way in r["intervals"]]
            held, of = (sum(day[name] for day in days) for name in ("held", "of"))
            yield {
                "errors": f"{times:g} x", "scatters": scatters, "poses": poses, "way": way,
                "days": len(days), "parameters [%]": f"{100.0 * held / of:.0f}",
            }  # fmt: skip


def _groups(rows: Sequence[Row], *names: str) -> Iterator[tuple[Any, list[Row]]]:
    """Rows that are alike in some keys, in order."""
    key = itemgetter(*names)
    return ((own, list(group)) for own, group in groupby(sorted(rows, key=key), key))
