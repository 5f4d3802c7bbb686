"""95 % intervals of parameters on days when the arm does not repeat exactly: how many hold the truth.

    python -m studies.research.benchmarks.days [--days 40] [--arm 6R] .. [--workers 2] [--json FILE]

Every day has geometric errors, a base anywhere, markers that are guessed, an instrument of 0.01 mm, and
an arm that scatters by so much (3-D RMS of the tip) from approach to approach: in its joints on even
days, at its tip on odd ones. The truth is MuJoCo's (``benchmarks.day``); posecal sees files.

Told are the share of intervals that hold, over the parameters that are estimated; of the worst one; and
the root mean square of error over standard deviation, 1 where both agree. The constants that the model
drops are absorbed by those it keeps, so the drawn errors are not the parameters. Their truth is what
``identify`` finds from exact readings of the same poses: the kept constants span every arm that the
dropped ones do, so the residual is zero (checked), and no noise is in it. Parameters of one day err
together: Wilson's intervals, which count each alone, are too short.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import calib
from studies.research.bench import Output, Row, bench, each, rms, several, table
from studies.research.benchmarks.day import ARMS, Setting, draw_day, write_day
from studies.research.withheld.figures import wilson

_SCATTERS = (0.0, 0.005, 0.01, 0.03)  # mm
_OFTEN = 40  # intervals of a parameter among which the worst is sought
_LARGEST_RESIDUAL = 1e-9  # m, of exact readings


def one_day(setting: Setting, index: int, *, seed: int) -> Row:
    """Which intervals of one day hold, with its setting."""
    day = draw_day(setting, index, seed)
    with TemporaryDirectory() as name:
        write_day(Path(name), day)
        cell = calib.load_cell(Path(name) / "cell.toml")
        found, truth = (
            calib.identify(cell, calib.load_measurements(cell, Path(name) / f"{table}.csv"))
            for table in ("measurements", "exact")
        )
    residual = truth.rms("fitted_all")
    if residual is None or residual > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {residual} m: no truth to measure against")
    low, high = found.interval().T
    estimated = (found.std > 0.0) & (truth.std >= 0.0)
    off = (found.values - truth.values) / np.where(estimated, found.std, 1.0)
    held = (low <= truth.values) & (truth.values <= high)
    names = [p.id for p in found.model.parameters]
    return {
        **asdict(setting),
        "day": index,
        "in_joints": bool(day.scatter.joints.any()),
        "held": {n: bool(held[i]) for i, n in enumerate(names) if estimated[i]},
        "off_in_std": {n: float(off[i]) for i, n in enumerate(names) if estimated[i]},
        "residual_m": residual,
        "sigma_mm": found.noise.sigma * 1e3,
    }


def coverage(days: Sequence[Row]) -> Row:
    """Of intervals, of the worst parameter of one arm with so many markers, and of their width."""
    held: dict[str, list[bool]] = {}
    for d in days:
        for name, own in d["held"].items():
            held.setdefault(f"{d['arm']}, {d['markers']} markers: {name}", []).append(own)
    flat = [h for own in held.values() for h in own]
    often = {n: own for n, own in held.items() if len(own) >= _OFTEN} or held
    worst = min(often, key=lambda name: sum(held[name]) / len(held[name]))
    return {
        "held": sum(flat),
        "intervals": len(flat),
        "ci95": wilson(sum(flat), len(flat)),
        "worst": worst,
        "worst_held": sum(held[worst]),
        "worst_intervals": len(held[worst]),
        "rms_off_in_std": rms([v for d in days for v in d["off_in_std"].values()]),
    }


_FACTORS: dict[str, Callable[[Row], str]] = {
    "arm": lambda d: str(d["arm"]),
    "scatter": lambda d: f"{d['scatter'] * 1e3:g} mm",
    "placed": lambda d: "in the joints" if d["in_joints"] else "at the tip",
    "approaches": lambda d: f"approaches {d['approaches']}",
    "poses": lambda d: f"poses {d['poses']}",
    "markers": lambda d: f"markers {d['markers']}",
}


def groups(days: Sequence[Row]) -> dict[str, list[Row]]:
    """All days, and those of each value of what was varied."""
    found = {"all": list(days)}
    for label in _FACTORS.values():
        own: dict[str, list[Row]] = {}
        for d in days:
            if d["scatter"] or label is not _FACTORS["placed"]:
                own.setdefault(label(d), []).append(d)
        found |= own if len(own) > 1 else {}
    return found


def _line(name: str, found: Row) -> Row:
    low, high = found["ci95"]
    counts = f"{found['worst_held']} of {found['worst_intervals']}"
    return {
        "days": name,
        "intervals\nhold [%]": f"{100 * found['held'] / found['intervals']:.1f}",
        "95 % [%]": f"{100 * low:.1f} to {100 * high:.1f}",
        "of": found["intervals"],
        "error\n[std]": f"{found['rms_off_in_std']:.2f}",
        "worst\n[%]": f"{100 * found['worst_held'] / found['worst_intervals']:.0f}",
        "its name": f"{found['worst']} ({counts})",
    }


@bench(
    several("--arm", tuple(ARMS)),
    several("--scatter", _SCATTERS, help="Of the arm, 3-D RMS, mm."),
    several("--approaches", (1, 2, 3), help="Of each pose."),
    several("--poses", (40, 80)),
    several("--markers", (1, 3)),
    days=40,
    days_help="Of each setting.",
    workers=True,
)
def main(days: int, seed: int, workers: int, **chosen: Sequence[Any]) -> Output:
    """Identify days and count which intervals hold."""
    names = ("arm", "scatter", "approaches", "poses", "markers")
    settings = [
        Setting(arm, scatter * 1e-3, *more)
        for arm, scatter, *more in product(*(chosen[name] for name in names))
    ]
    found = each(one_day, product(settings, range(days)), workers, seed=seed)
    summaries = {name: coverage(own) for name, own in groups(found).items()}
    shown = table(_line(name, own) for name, own in summaries.items())
    return [shown], {"seed": seed, "summaries": summaries, "days": found}


if __name__ == "__main__":
    main()
