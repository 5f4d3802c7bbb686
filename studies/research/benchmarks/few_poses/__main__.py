"""What an identification is worth when poses are few: held-out error, and whether its claims hold.

    python -m studies.research.benchmarks.few_poses [--days 40] [--peers FOLDER] [--json FILE]

The first 8, 10, 12, 15, 20 and 40 of one day's poses, drawn anywhere within the limits, go to posecal,
to a ridge whose one penalty is chosen by cross-validation, and, on request, to FIGAROH's estimators
``map`` and ``map_cv``. The truth is plain NumPy (``truth``), and what counts is the distance of the
predicted from the true points at 200 other poses. Days take turns with one marker and three, and with
an arm that comes back exactly or to within 0.02 mm and 20 urad, of which the cell says nothing.

Coverage: of 95 % intervals of parameters, whose truth is what a fit to exact readings of the 200 poses
finds (its residual is checked, so the constants that posecal drops are absorbed without error); of the
coordinates of points at 50 of those poses, by the covariance and its degrees of freedom; and of what
``posecal identify`` promises at its own targets. Errors of one day go together, so the interval of a
share counts no more than what the days scatter by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.model.build import build
from calib.poses import poses_at
from studies.research.bench import Output, Row, bench, count, each, rms_3d, several, table
from studies.research.benchmarks.day import SEVEN
from studies.research.benchmarks.few_poses.day import (
    SIGMA,
    Day,
    Setting,
    cells_of,
    draw_day,
    interpreter,
    ridge,
    solved_by_figaroh,
    table_of,
)
from studies.research.benchmarks.few_poses.tables import (
    coverage_table,
    errors_table,
    kept,
    true_values,
)
from studies.research.benchmarks.peers.judge import Left
from studies.research.withheld.robots import LIGHT

ARMS = {"6R": LIGHT, "7R": SEVEN}
SIZES = (1.0, 10.0)
POSES = (8, 10, 12, 15, 20, 40)
RIDGE = "ridge by CV"
_TURNS = tuple(product((1, 3), (False, True)))  # markers, whether the arm scatters: day by day


def rows_of_day(
    arm: str, times: float, index: int, seed: int, poses: Sequence[int], python: Path | None
) -> list[Row]:
    """What came of the tables of one day; python : that has FIGAROH, None to do without."""
    setting = Setting(times, *_TURNS[index % len(_TURNS)])
    day = draw_day(ARMS[arm], setting, index, seed)
    cells = cells_of(day)
    truth = {way: true_values(cell, day) for way, cell in cells.items()}
    return [
        {"arm": arm, **asdict(setting), "day": index, "poses": n}
        | _one_table(day, n, cells, truth, python)
        for n in poses
    ]


def _one_table(
    day: Day, n: int, cells: dict[str, calib.Cell], truth: dict[str, Array], python: Path | None
) -> Row:
    """Errors, claims that hold, and why there is no answer, by estimator."""
    exact, there = day.points(day.held), poses_at(day.held)
    data = table_of(day.q[:n], day.read[:n])
    answers: dict[str, Array | str] = {}
    claims: Row = {}
    for way, cell in cells.items():
        try:
            found = calib.identify(cell, data)
        except calib.CalibError as refused:
            answers[way] = str(refused)
            continue
        answers[way] = found.predict(there)
        claims[way] = kept(cell, found, truth[way], day)
    model = build(next(iter(cells.values())), data.poses).model
    answers[RIDGE] = model.predict(ridge(model, data, SIGMA, np.random.default_rng(n)), there)
    if python is not None:
        answers |= solved_by_figaroh(python, day, n)
    return {
        "errors_m": {
            way: None if isinstance(own, str) else rms_3d(own - exact)
            for way, own in answers.items()
        },
        "why": {way: own for way, own in answers.items() if isinstance(own, str)},
        "kept": claims,
    }  # fmt: skip


@bench(
    several("--arm", tuple(ARMS)),
    several("--poses", POSES),
    click.option(
        "--peers", type=click.Path(path_type=Path), help="Folder of FIGAROH's environment."
    ),
    count("--peer-days", 4, help="Of each arm and size, that FIGAROH gets too."),
    days=40,
    days_help="Of each arm and size of errors; four take turns with all conditions.",
    workers=True,
)
def main(
    days: int,
    arm: tuple[str, ...],
    poses: tuple[int, ...],
    seed: int,
    workers: int,
    peers: Path | None,
    peer_days: int,
) -> Output:
    """Identify from few poses, and hold errors and claims against the truth."""
    python = interpreter(peers) if peers is not None else None
    if isinstance(python, Left):
        raise calib.CalibError(str(python))
    tasks = [
        (one, times, index, seed, poses, python if index < peer_days else None)
        for one, times, index in product(arm, SIZES, range(days))
    ]
    rows = [row for own in each(rows_of_day, tasks, workers) for row in own]
    shown = ["Held-out error, 3-D RMS", table(errors_table(rows))]
    shown += ["\nWhat holds of what was said", table(coverage_table(rows))]
    return shown, {"seed": seed, "tables": rows}


if __name__ == "__main__":
    main()
