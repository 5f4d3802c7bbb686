"""Whether what an identification says of itself holds; errors and shares of all days, a figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

import calib
from calib.arrays import Array, Mask
from calib.model.build import build
from calib.poses import Poses, poses_at
from calib.uncertainty.budget import accuracy_at_targets
from calib.uncertainty.expanded import coverage_factor, effective_freedom
from studies.plots.style import SERIES, styled, tidy
from studies.research.benchmarks.few_poses.day import DEFAULT, Day, exact_values, table_of
from studies.research.withheld.figures import wilson
from studies.tables import number, plain_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


POINTS = 50  # held-out poses at which points count
_LARGEST_RESIDUAL = 1e-9  # m, of exact readings
_NORMAL = 1.96


@dataclass(frozen=True)
class Held:
    """How many of so many intervals hold what is true."""

    held: int
    of: int


@dataclass(frozen=True)
class Kept:
    """What became of the claims of one identification.

    parameters, points : 95 % intervals; normal : of points with 1.96 in place of the product's factor
    targets : poses whose RMS error is within the product's 95 % bound for them; whole : whether the RMS
        over the targets is within the RMS of these bounds
    promised, came : m, RMS error expected at the targets, and what it is
    outliers : poses that were left out; none of a day deserves it
    std : m, RMS over the points of what the covariance has a point err by; off : what it errs by
    """

    parameters: Held
    points: Held
    normal: Held
    targets: Held
    whole: Held
    outliers: int
    promised: float
    came: float
    std: float
    off: float


def true_values(cell: calib.Cell, day: Day) -> Array:
    """What the model's parameters are of this arm, shape (p,), SI, by exact readings of other poses.

    Raises RuntimeError where the model cannot stand for the arm.
    """
    exact = table_of(day.held, day.points(day.held))
    values, left = exact_values(build(cell, exact.poses).model, exact)
    if left > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {left} m: no truth to measure against")
    return values


def kept(cell: calib.Cell, found: calib.Identification, truth: Array, day: Day) -> Kept:
    """Hold the claims against the truth (p,)."""
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
    return Kept(
        parameters=_held(holds),
        points=_held(np.abs(off) <= factor * std),
        normal=_held(np.abs(off) <= _NORMAL * std),
        targets=_held(errors <= expected.expanded),
        whole=_held(np.array([came <= claim.rms(expected.expanded)])),
        outliers=int(np.count_nonzero(found.fit.outlier)),
        promised=claim.rms(expected.errors),
        came=came,
        std=float(np.sqrt((std**2).sum(axis=-1).mean())),
        off=float(np.sqrt((off**2).sum(axis=-1).mean())),
    )


def share(own: Sequence[Held]) -> tuple[float, float, float]:
    """Share that holds over days, and its 95 % interval (Wilson).

    Errors of a day go together: the count is divided by how much wider days scatter than so many
    independent intervals would, and of days that all hold everything each counts once.

    >>> share([Held(9, 10), Held(10, 10), Held(9, 10), Held(10, 10)])[0]
    0.95
    >>> share([Held(10, 10)] * 20) == share([Held(1, 1)] * 20)
    True
    """
    hits, of = (np.array([getattr(h, name) for h in own]) for name in ("held", "of"))
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


def _held(holds: Mask) -> Held:
    return Held(int(np.count_nonzero(holds)), int(holds.size))


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


@styled
def error_by_poses(rows: Sequence[Row]) -> Figure:
    """Mean error of each estimator; where it does not always answer it has no point."""
    from matplotlib.figure import Figure

    kinds = sorted({(r["times"], r["markers"]) for r in rows})
    ways = list(dict.fromkeys(way for r in rows for way in r["errors_m"]))
    figure = Figure(figsize=(9.0, 2.6 + 2.2 * ((len(kinds) + 1) // 2)), layout="constrained")
    panels = figure.subplots(
        (len(kinds) + 1) // 2, 2, squeeze=False, sharex=True, sharey=True
    ).ravel()
    for panel, (times, markers) in zip(panels, kinds, strict=False):
        own = [r for r in rows if (r["times"], r["markers"]) == (times, markers)]
        for look, way in zip(SERIES, ways, strict=False):
            points = []
            for poses in sorted({r["poses"] for r in own}):
                found = errors_of([r for r in own if r["poses"] == poses]).get(way)
                if found is not None and found["silent"] == 0:
                    points.append((poses, found["mean_mm"]))
            panel.plot(*zip(*points, strict=True), label=way, **look.line) if points else None
        told = f"{markers} marker{'s' * (markers > 1)}, errors {times:g} x usual"
        panel.set(title=told, xscale="log", yscale="log")
        panel.set_xticks(ticks := sorted({r["poses"] for r in rows}), [str(t) for t in ticks])
        panel.minorticks_off()
        panel.yaxis.set_major_formatter("{x:g}")
        tidy(panel)
    for panel in panels[::2]:
        panel.set_ylabel("held-out error, mean [mm]")
    for panel in panels[-2:]:
        panel.set_xlabel("poses that are fitted")
    lines = {line.get_label(): line for panel in panels for line in panel.get_lines()}
    figure.legend(list(lines.values()), list(map(str, lines)), loc="outside lower center", ncols=5)
    return figure
