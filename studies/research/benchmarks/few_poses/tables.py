"""What days say together: errors over posecal's, and shares of intervals that hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from studies.research.benchmarks.few_poses.coverage import Held, share
from studies.research.benchmarks.few_poses.files import DEFAULT
from studies.tables import number, plain_table

WORSE = 1.02
COVERED = (10, 15, 20, 40)  # poses at which coverage is told
SHARES = ("parameters", "points", "normal", "targets", "whole")
Row = dict[str, Any]


def errors_table(rows: Sequence[Row]) -> Table:
    """One line for each size of errors, number of markers and of poses, and estimator.

    A star: posecal's mean error is larger by more than 2 %.
    """
    table = plain_table(
        ("errors", "right"), ("mark-\ners", "right"), ("poses", "right"), ("\nestimator", "left"),
        ("\ndays", "right"), ("no\nanswer", "right"), ("median\n[mm]", "right"),
        ("mean\n[mm]", "right"), ("median /\nposecal's", "right"), ("mean /\nposecal's", "right"),
        ("posecal worse\nby 2 %, days", "right"),
    )  # fmt: skip
    for own in _groups(rows, lambda r: (r["times"], r["markers"], r["poses"])):
        for way, found in errors_of(own).items():
            table.add_row(
                f"{own[0]['times']:g} x", str(own[0]["markers"]), str(own[0]["poses"]), way,
                *(str(found[k]) for k in ("days", "silent")),
                *(number(found[k]) for k in ("median_mm", "mean_mm")),
                *(_ratio(found[k]) for k in ("median_ratio", "mean_ratio")),
                "" if way == DEFAULT else _worse(found),
            )  # fmt: skip
    return table


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


def coverage_table(rows: Sequence[Row]) -> Table:
    """One line for each size of errors, arm that scatters or not, number of poses, and way.

    Shares that hold, with their 95 % intervals: of parameters, of coordinates of points by the
    product's factor and by 1.96, and of targets within their 95 % bound. Then the RMS that came over
    that which was said of the targets, and how many poses a table lost as outliers, wrongly.
    """
    table = plain_table(
        ("\nerrors", "right"), ("scat-\nters", "left"), ("\nposes", "right"), ("\nway", "left"),
        ("\ndays", "right"), ("parame-\nters [%]", "right"), ("points\n[%]", "right"),
        ("points,\n1.96 [%]", "right"), ("error\n[std]", "right"), ("targets\n[%]", "right"),
        ("came /\nsaid", "right"), ("wrong\noutliers", "right"),
    )  # fmt: skip
    covered = [r for r in rows if r["poses"] in COVERED]
    for own in _groups(covered, lambda r: (r["times"], r["scatters"], r["poses"])):
        for way, found in coverage_of(own).items():
            table.add_row(
                f"{own[0]['times']:g} x", "yes" if own[0]["scatters"] else "no",
                str(own[0]["poses"]), way, str(found["days"]),
                *(_percent(found[k]) for k in ("parameters", "points", "normal")),
                f"{found['off_over_std']:.2f}",
                _percent(found["targets"]), f"{found['came_over_promised']:.2f}",
                f"{found['outliers']:.2f}",
            )  # fmt: skip
    return table


def coverage_of(rows: Sequence[Row]) -> dict[str, Row]:
    """Shares that hold with their intervals, and errors over what was promised, RMS over days."""
    ways = dict.fromkeys(way for r in rows for way in r["kept"])
    found: dict[str, Row] = {}
    for way in ways:
        own = [r["kept"][way] for r in rows if way in r["kept"]]
        found[way] = {
            "days": len(own),
            **{k: share([Held(**one[k]) for one in own]) for k in SHARES},
            "off_over_std": _rms([one["off"] / one["std"] for one in own]),
            "outliers": float(np.mean([one["outliers"] for one in own])),
            "came_over_promised": _rms([one["came"] / one["promised"] for one in own]),
        }
    return found


def _groups(rows: Sequence[Row], key: Callable[[Row], Any]) -> Iterator[list[Row]]:
    found: dict[Any, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    yield from (found[k] for k in sorted(found))


def _rms(ratios: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(ratios))))


def _worse(found: Row) -> str:
    """Days on which posecal is worse, with a star where its mean is."""
    ratio = found["mean_ratio"]
    star = " *" if ratio is not None and ratio * WORSE < 1.0 else ""
    return f"{found['worse']} of {found['both']}{star}"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _percent(found: tuple[float, float, float]) -> str:
    rate, low, high = (100 * v for v in found)
    return f"{rate:.0f} {low:.0f}-{high:.0f}"
