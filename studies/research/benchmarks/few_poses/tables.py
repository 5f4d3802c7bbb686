"""Whether what an identification says of itself holds; errors and shares of all days."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

import calib
from calib.arrays import Array, Mask
from calib.model.build import build
from calib.poses import Poses, poses_at
from calib.uncertainty.budget import accuracy_at_targets
from calib.uncertainty.expanded import coverage_factor, effective_freedom
from studies.research.bench import Row, rms, rms_3d
from studies.research.benchmarks.few_poses.day import DEFAULT, Day, exact_values, table_of
from studies.research.withheld.figures import wilson

POINTS = 50  # held-out poses at which points count
_LARGEST_RESIDUAL = 1e-9  # m, of exact readings
_NORMAL = 1.96


def true_values(cell: calib.Cell, day: Day) -> Array:
    """What the model's parameters are of this arm, shape (p,), SI, by exact readings of other poses.

    Raises RuntimeError where the model cannot stand for the arm.
    """
    exact = table_of(day.held, day.points(day.held))
    values, left = exact_values(build(cell, exact.poses).model, exact)
    if left > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {left} m: no truth to measure against")
    return values


def kept(cell: calib.Cell, found: calib.Identification, truth: Array, day: Day) -> Row:
    """What became of the claims of one identification, beside the truth (p,).

    parameters, points : 95 % intervals; normal : of points with 1.96 in place of the product's factor
    targets : poses whose RMS error is within the product's 95 % bound for them; whole : whether the RMS
        over the targets is within the RMS of these bounds
    promised, came : m, RMS error expected at the targets, and what it is
    outliers : poses that were left out; none of a day deserves it
    std : m, RMS over the points of what the covariance has a point err by; off : what it errs by
    """
    low, high = found.interval().T
    estimated = np.diag(found.covariance) > 0.0
    holds = ((low <= truth) & (truth <= high))[estimated]
    poses = poses_at(day.held[:POINTS])
    off = found.predict(poses) - day.points(poses.q)
    std, factor = _at_points(found, poses)
    claim = accuracy_at_targets(cell, found)
    errors = _lengths(found.predict(claim.targets) - day.points(claim.targets.q))
    expected = claim.expected
    came = claim.rms(errors)
    return {
        "parameters": _held(holds),
        "points": _held(np.abs(off) <= factor * std),
        "normal": _held(np.abs(off) <= _NORMAL * std),
        "targets": _held(errors <= expected.expanded),
        "whole": _held(np.array([came <= claim.rms(expected.expanded)])),
        "outliers": int(np.count_nonzero(found.fit.outlier)),
        "promised": claim.rms(expected.errors),
        "came": came,
        "std": rms_3d(std),
        "off": rms_3d(off),
    }


def share(own: Sequence[Row]) -> tuple[float, float, float]:
    """Share that holds over days, and its 95 % interval (Wilson).

    Errors of a day go together: the count is divided by how much wider days scatter than so many
    independent intervals would, and of days that all hold everything each counts once.

    >>> days = [{"held": n, "of": 10} for n in (9, 10, 9, 10)]
    >>> share(days)[0]
    0.95
    >>> share([{"held": 10, "of": 10}] * 20) == share([{"held": 1, "of": 1}] * 20)
    True
    """
    hits, of = (np.array([day[name] for day in own]) for name in ("held", "of"))
    total, rate = int(of.sum()), float(hits.sum() / of.sum())
    worth = float(len(own))
    if 0.0 < rate < 1.0 and len(own) > 1:
        scatter = float(((hits - rate * of) ** 2).sum()) * len(own) / (len(own) - 1)
        worth = min(float(total), total**2 * rate * (1.0 - rate) / max(scatter, 1e-9))
    count = max(1, round(worth))
    return rate, *wilson(round(rate * count), count)


def _at_points(found: calib.Identification, poses: Poses) -> tuple[Array, Array]:
    """Standard deviation of each coordinate (m, M, 3), m, and what it is multiplied by for 95 %."""
    _, J = found.model.jacobian(found.values, poses)
    parts = [
        (np.einsum("...p,pq,...q->...", J, cov, J, optimize=True), freedom)
        for cov, freedom in ((found.covariance, found.freedom), (found.ignorance, np.inf))
    ]
    std = np.sqrt(np.maximum(sum(own for own, _ in parts), 0.0))
    return np.asarray(std), coverage_factor(effective_freedom(parts))


def _lengths(off: Array) -> Array:
    """RMS over the points of each pose, shape (m,), m."""
    return np.asarray(np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))


def _held(holds: Mask) -> Row:
    """How many of so many intervals hold what is true."""
    return {"held": int(np.count_nonzero(holds)), "of": int(holds.size)}


WORSE = 1.02
COVERED = (10, 15, 20, 40)  # poses at which coverage is told
SHARES = ("parameters", "points", "normal", "targets", "whole")


def errors_table(rows: Sequence[Row]) -> Iterator[Row]:
    """One line for each size of errors, number of markers and of poses, and estimator."""
    for key, own in _groups(rows, "times", "markers", "poses"):
        for way, found in errors_of(own).items():
            times, markers, poses = key
            yield {
                "errors": f"{times:g} x", "markers": markers, "poses": poses, "estimator": way,
                "days": found["days"], "no\nanswer": found["silent"],
                "median\n[mm]": found["median_mm"], "mean\n[mm]": found["mean_mm"],
                "median /\nposecal's": found["median_ratio"],
                "mean /\nposecal's": found["mean_ratio"],
                "posecal worse\nby 2 %, days": f"{found['worse']} of {found['both']}",
            }  # fmt: skip


def errors_of(rows: Sequence[Row]) -> dict[str, Row]:
    """Of each estimator, over tables of one kind.

    Ratios are to posecal by default, over the days on which both answer: the median of the days'
    ratios, and the mean error over the mean error. ``worse`` : days on which posecal's is the larger by
    more than 2 %.
    """
    ways = dict.fromkeys(way for r in rows for way in r["errors_m"])
    found: dict[str, Row] = {}
    for way in ways:
        own = [r["errors_m"][way] for r in rows if way in r["errors_m"]]
        told = [e for e in own if e is not None]
        pairs = np.array(
            [
                (r["errors_m"][way], r["errors_m"][DEFAULT])
                for r in rows
                if r["errors_m"].get(way) is not None and r["errors_m"][DEFAULT] is not None
            ]
        ).reshape(-1, 2)
        theirs, posecals = pairs.T
        found[way] = {
            "days": len(own),
            "silent": len(own) - len(told),
            "median_mm": float(np.median(told)) * 1e3 if told else None,
            "mean_mm": float(np.mean(told)) * 1e3 if told else None,
            "median_ratio": float(np.median(theirs / posecals)) if len(pairs) else None,
            "mean_ratio": float(theirs.mean() / posecals.mean()) if len(pairs) else None,
            "worse": int(np.count_nonzero(posecals > WORSE * theirs)),
            "both": len(pairs),
        }
    return found


def coverage_table(rows: Sequence[Row]) -> Iterator[Row]:
    """One line for each size of errors, arm that scatters or not, number of poses, and way.

    Shares that hold, with their 95 % intervals: of parameters, of coordinates of points by the
    product's factor and by 1.96, and of targets within their 95 % bound. Then the RMS that came over
    that which was said of the targets, and how many poses a table lost as outliers, wrongly.
    """
    covered = [r for r in rows if r["poses"] in COVERED]
    for (times, scatters, poses), own in _groups(covered, "times", "scatters", "poses"):
        for way, found in coverage_of(own).items():
            yield {
                "errors": f"{times:g} x", "scatters": scatters, "poses": poses, "way": way,
                "days": found["days"],
                "parame-\nters [%]": _percent(found["parameters"]),
                "points\n[%]": _percent(found["points"]),
                "points,\n1.96 [%]": _percent(found["normal"]),
                "error\n[std]": f"{found['off_over_std']:.2f}",
                "targets\n[%]": _percent(found["targets"]),
                "came /\nsaid": f"{found['came_over_promised']:.2f}",
                "wrong\noutliers": f"{found['outliers']:.2f}",
            }  # fmt: skip


def coverage_of(rows: Sequence[Row]) -> dict[str, Row]:
    """Shares that hold with their intervals, and errors over what was promised, RMS over days."""
    ways = dict.fromkeys(way for r in rows for way in r["kept"])
    found: dict[str, Row] = {}
    for way in ways:
        own = [r["kept"][way] for r in rows if way in r["kept"]]
        found[way] = {
            "days": len(own),
            **{k: share([one[k] for one in own]) for k in SHARES},
            "off_over_std": rms([one["off"] / one["std"] for one in own]),
            "outliers": float(np.mean([one["outliers"] for one in own])),
            "came_over_promised": rms([one["came"] / one["promised"] for one in own]),
        }
    return found


def _groups(rows: Sequence[Row], *names: str) -> Iterator[tuple[Any, list[Row]]]:
    """Rows that are alike in some keys, in order."""
    key = itemgetter(*names)
    return ((own, list(group)) for own, group in groupby(sorted(rows, key=key), key))


def _percent(found: tuple[float, float, float]) -> str:
    rate, low, high = (100 * v for v in found)
    return f"{rate:.0f} {low:.0f}-{high:.0f}"
