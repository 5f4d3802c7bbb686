"""Days on which nothing is wrong but that the arm does not repeat: what is said, promised, and comes.

    python -m studies.research.benchmarks.days [--days 40] [--only identify] [--arm 6R] .. [--json FILE]

Every day has geometric errors, a base anywhere, markers that are guessed, an instrument of 0.01 mm, and
an arm that scatters by so much (3-D RMS of the tip) from approach to approach: in its joints on even
days, at its tip on odd ones. The truth is MuJoCo's (``benchmarks.day``); posecal sees files.

diagnose: an alarm is a name, or a place that depends on anything but ``pose``. With --holdout a share
of the configurations stands aside.

identify: the share of 95 % intervals that hold the truth, over the parameters that are estimated; of
the worst one; and the root mean square of error over standard deviation, 1 where both agree. The
constants that the model drops are absorbed by those it keeps, so the drawn errors are not the
parameters. Their truth is what ``identify`` finds from exact readings of the same poses: the kept
constants span every arm that the dropped ones do, so the residual is zero (checked), and no noise is
in it. Parameters of one day err together: Wilson's intervals, which count each alone, are too short.

enough: what comes at 200 targets that the cell names, over what was promised for them, RMS over days.
What comes is the distance of where the arm stands from where the identified model has it, which is what
compensation leaves: "parameters" of the arm on average, "arm" of one fresh approach of each target.
Goals are so many times what comes (with the arm) on days of the same setting: "said" counts how often
the goal is said to be reached, "right" how often the error that then comes is below it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from doe.ahead.enough import Enough, enough
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.diagnose.make import findings
from studies.research.benchmarks.day import ARMS, Day, Setting, draw_day, write_day
from studies.research.withheld.figures import wilson
from studies.tables import plain_table

PARTS = ("diagnose", "identify", "enough")
GOALS = (0.8, 0.9, 1.1, 1.25)
_SCATTERS = (0.0, 0.005, 0.01, 0.03)  # mm
_OFTEN = 40  # intervals of a parameter among which the worst is sought
_LARGEST_RESIDUAL = 1e-9  # m, of exact readings
_GOALS = (1e-7, 1e-2)  # m, between which the goal is sought that is just reached

Row = dict[str, Any]


@one_blas_thread
def one_day(
    setting: Setting, index: int, *, parts: Sequence[str], holdout: float, seed: int
) -> Row:
    """What was found on one day, part by part, with the setting."""
    day = draw_day(setting, index, seed)
    found: Row = {**asdict(setting), "day": index, "in_joints": bool(day.scatter.joints.any())}
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, day)
        cell = calib.load_cell(folder / "cell.toml")
        data = calib.load_measurements(cell, folder / "measurements.csv")
        if "diagnose" in parts:
            found["diagnose"] = _diagnosed(cell, data, holdout, index)
        if "identify" in parts:
            exact = calib.load_measurements(cell, folder / "exact.csv")
            found["identify"] = _identified(cell, data, exact)
        if "enough" in parts:
            found["enough"] = _enough(cell, data, folder / "targets.csv", day)
    return found


def _diagnosed(cell: calib.Cell, data: calib.Measurements, holdout: float, seed: int) -> Row:
    heldout = None
    if holdout:
        data, heldout = data.split(holdout, np.random.default_rng(seed))
    fields = findings(calib.diagnose(cell, data, heldout=heldout)).model_dump(
        mode="json", by_alias=True
    )
    named = [f"{e['effect']}:{e['where']}" for e in fields["effects"]]
    places = [f"{p['where']} by {p['depends_on']}" for p in fields["located"]]
    alarm = bool(named) or any(p["depends_on"] != "pose" for p in fields["located"])
    return {"verdict": fields["verdict"], "named": named, "located": places, "alarm": alarm}


def _identified(cell: calib.Cell, data: calib.Measurements, exact: calib.Measurements) -> Row:
    found, truth = calib.identify(cell, data), calib.identify(cell, exact)
    residual = truth.rms("fitted_all")
    if residual is None or residual > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {residual} m: no truth to measure against")
    low, high = found.interval().T
    estimated = (found.std > 0.0) & (truth.std >= 0.0)
    off = (found.values - truth.values) / np.where(estimated, found.std, 1.0)
    held = (low <= truth.values) & (truth.values <= high)
    names = [p.id for p in found.model.parameters]
    return {
        "held": {n: bool(held[i]) for i, n in enumerate(names) if estimated[i]},
        "off_in_std": {n: float(off[i]) for i, n in enumerate(names) if estimated[i]},
        "residual_m": residual,
        "sigma_mm": found.noise.sigma * 1e3,
        "noise": found.noise.source,
        "outliers": int(np.count_nonzero(found.fit.outlier)),
    }


def _enough(cell: calib.Cell, data: calib.Measurements, targets: Path, day: Day) -> Row:
    answer = enough(cell, data)
    promised = answer.steps[0].task_rms
    if answer.found is None:
        return {"promised_m": promised, "parameters_m": None, "arm_m": None, "reached_from_m": None}
    poses, _ = calib.load_targets(cell, targets)
    expected = answer.found.predict(poses)
    return {
        "promised_m": promised,
        "parameters_m": _rms(expected - day.reached),
        "arm_m": _rms(expected - day.approached),
        "reached_from_m": _reached_from(answer),
    }


def _reached_from(answer: Enough) -> float | None:
    """The smallest goal, m, of which it is said that it is reached now, by bisection."""

    def reached(goal: float) -> bool:
        return replace(answer, goal=goal).needed == 0

    low, high = np.log(_GOALS)
    if not reached(float(np.exp(high))):
        return None
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(float(np.exp(middle))) else (middle, high)
    return float(np.exp(high))


def _rms(vectors: Array) -> float:
    """3-D root mean square per point."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def alarms(days: Sequence[Row]) -> Row:
    """False alarms, and the verdicts."""
    own = [d["diagnose"] for d in days]
    hits = sum(d["alarm"] for d in own)
    return {
        "alarms": hits,
        "days": len(own),
        "ci95": wilson(hits, len(own)),
        "verdicts": dict(Counter(d["verdict"] for d in own).most_common()),
    }


def coverage(days: Sequence[Row]) -> Row:
    """Of intervals, of the worst parameter of one arm with so many markers, and of their width."""
    held: dict[str, list[bool]] = {}
    for d in days:
        for name, own in d["identify"]["held"].items():
            held.setdefault(f"{d['arm']}, {d['markers']} markers: {name}", []).append(own)
    flat = [h for own in held.values() for h in own]
    often = {n: own for n, own in held.items() if len(own) >= _OFTEN} or held
    worst = min(often, key=lambda name: sum(held[name]) / len(held[name]))
    off = [v for d in days for v in d["identify"]["off_in_std"].values()]
    return {
        "held": sum(flat),
        "intervals": len(flat),
        "ci95": wilson(sum(flat), len(flat)),
        "worst": worst,
        "worst_held": sum(held[worst]),
        "worst_intervals": len(held[worst]),
        "rms_off_in_std": float(np.sqrt(np.mean(np.square(off)))),
        "noise": dict(Counter(d["identify"]["noise"] for d in days).most_common()),
    }


def promises(days: Sequence[Row]) -> Row:
    """What comes over what was promised, and how often a goal is said to be reached, and rightly."""
    own = [d["enough"] for d in days if d["enough"]["arm_m"] is not None]
    promised = np.array([d["promised_m"] for d in own])
    arm = np.array([d["arm_m"] for d in own])
    parameters = np.array([d["parameters_m"] for d in own])
    found: Row = {
        "days": len(own),
        "promised_mm": float(np.sqrt(np.mean(promised**2))) * 1e3,
        "parameters_mm": float(np.sqrt(np.mean(parameters**2))) * 1e3,
        "arm_mm": float(np.sqrt(np.mean(arm**2))) * 1e3,
        "parameters_over_promised": float(np.sqrt(np.mean((parameters / promised) ** 2))),
        "arm_over_promised": float(np.sqrt(np.mean((arm / promised) ** 2))),
        "goals": [],
    }
    usual = _usual(days)
    start = np.array([d["reached_from_m"] or math.inf for d in own])
    for factor in GOALS:
        said = start <= factor * usual
        right = said & (arm <= factor * usual)
        found["goals"].append(
            {"times": factor, "said": int(said.sum()), "right": int(right.sum()), "of": len(own)}
        )
    return found


def _usual(days: Sequence[Row]) -> Array:
    """What comes at the targets on days of the same setting, RMS, m, one value a day."""
    squares: dict[Setting, list[float]] = {}
    own = [d for d in days if d["enough"]["arm_m"] is not None]
    for d in own:
        squares.setdefault(_setting(d), []).append(d["enough"]["arm_m"] ** 2)
    return np.array([math.sqrt(float(np.mean(squares[_setting(d)]))) for d in own])


def _setting(day: Row) -> Setting:
    return Setting(**{name: day[name] for name in Setting.__dataclass_fields__})


Summary = Callable[[Sequence[Row]], Row]
SUMMARIES: dict[str, Summary] = {"diagnose": alarms, "identify": coverage, "enough": promises}
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


_HEADINGS: dict[str, tuple[tuple[str, str], ...]] = {
    "diagnose": (
        ("\ndays", "right"), ("\nalarms", "right"), ("\n95 % [%]", "right"), ("\nverdicts", "left"),
    ),
    "identify": (
        ("intervals\nhold [%]", "right"), ("\n95 % [%]", "right"), ("\nof", "right"),
        ("error\n[std]", "right"), ("worst\n[%]", "right"), ("\nits name", "left"),
    ),
    "enough": (
        ("\ndays", "right"), ("promised\n[mm]", "right"), ("param-\neters", "right"),
        ("\nand arm", "right"), ("param. /\npromised", "right"), ("and arm /\npromised", "right"),
        *((f"said, right\nat {g:g}", "right") for g in GOALS),
    ),
}  # fmt: skip


def cells(part: str, found: Row) -> list[str]:
    """One line of a table."""
    if part == "diagnose":
        said = ", ".join(f"{n} {verdict}" for verdict, n in found["verdicts"].items())
        return [str(found["days"]), str(found["alarms"]), _percent(found["ci95"]), said]
    if part == "identify":
        worst = found["worst_held"] / found["worst_intervals"]
        return [
            f"{100 * found['held'] / found['intervals']:.1f}",
            _percent(found["ci95"]),
            str(found["intervals"]),
            f"{found['rms_off_in_std']:.2f}",
            f"{100 * worst:.0f}",
            f"{found['worst']} ({found['worst_held']} of {found['worst_intervals']})",
        ]
    lengths = [f"{found[k]:.4f}" for k in ("promised_mm", "parameters_mm", "arm_mm")]
    ratios = [f"{found[f'{k}_over_promised']:.2f}" for k in ("parameters", "arm")]
    goals = [f"{g['said']}, {g['right']}" for g in found["goals"]]
    return [str(found["days"]), *lengths, *ratios, *goals]


def _percent(ends: tuple[float, float]) -> str:
    return f"{100 * ends[0]:.1f} to {100 * ends[1]:.1f}"


def all_days(tasks: Iterable[tuple[Setting, int]], workers: int, **options: Any) -> list[Row]:
    """Every day, in the order of the tasks."""
    settings, indices = zip(*tasks, strict=True)
    work = partial(one_day, **options)
    if workers == 1:
        return list(map(work, settings, indices))
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(work, settings, indices, chunksize=4))


def _several(name: str, values: Sequence[Any], **more: Any) -> Callable[[Any], Any]:
    """An option that may be given several times, by default with each of the values."""
    kind = click.Choice(values) if isinstance(values[0], str) else type(values[0])
    return click.option(name, multiple=True, default=values, show_default=True, type=kind, **more)


@click.command()
@click.option("--days", type=click.IntRange(min=1), default=40, show_default=True,
              help="Days of each setting.")  # fmt: skip
@_several("--only", PARTS, help="What to ask.")
@_several("--arm", tuple(ARMS))
@_several("--scatter", _SCATTERS, help="Of the arm, 3-D RMS, mm.")
@_several("--approaches", (1, 2, 3), help="Of each pose.")
@_several("--poses", (40, 80))
@_several("--markers", (1, 3))
@click.option("--holdout", type=float, default=0.0, help="Share that the diagnosis sets aside.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All days.")
@one_line_faults
def main(
    days: int,
    only: tuple[str, ...],
    arm: tuple[str, ...],
    scatter: tuple[float, ...],
    approaches: tuple[int, ...],
    poses: tuple[int, ...],
    markers: tuple[int, ...],
    holdout: float,
    seed: int,
    workers: int,
    json_path: Path | None,
) -> None:
    """Measure days and print what became of them."""
    chosen = product(arm, (s * 1e-3 for s in scatter), approaches, poses, markers)
    tasks = [(Setting(*one), index) for one in chosen for index in range(days)]
    found = all_days(tasks, workers, parts=only, holdout=holdout, seed=seed)
    console = console_for(None)
    summaries: Row = {}
    for part in (part for part in PARTS if part in only):
        table = plain_table((f"\n{part}", "left"), *_HEADINGS[part])
        summaries[part] = {name: SUMMARIES[part](own) for name, own in groups(found).items()}
        for name, summary in summaries[part].items():
            table.add_row(name, *cells(part, summary))
        console.print(table)
        console.print()
    if json_path is not None:
        write_files({json_path: json_text({"seed": seed, "summaries": summaries, "days": found})})


if __name__ == "__main__":
    main()
