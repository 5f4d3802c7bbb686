"""What an identification is worth when poses are few: held-out error, and whether its claims hold.

    python -m studies.research.benchmarks.few_poses [--days 40] [--json FILE]

The first 8, 10, 12, 15, 20 and 40 of one day's poses, drawn anywhere within the limits, go to posecal
and to a ridge whose one penalty is chosen by cross-validation. The truth is plain NumPy, and what
counts is the distance of the predicted from the true points at 200 other poses. Days take
turns with one marker and three, and with an arm that comes back exactly or to within 0.02 mm and 20
urad, of which the cell says nothing.

Coverage: of 95 % intervals of parameters, whose truth is what a fit to exact readings of the 200 poses
finds (its residual is checked, so the constants that posecal drops are absorbed without error).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import product

import numpy as np

import calib
from calib.arrays import Array
from calib.model.build import build
from calib.poses import poses_at
from studies.research.bench import Output, Row, bench, each, rms_3d, several, table
from studies.research.benchmarks.day import SEVEN
from studies.research.benchmarks.few_poses.day import (
    DEFAULT,
    SIGMA,
    Day,
    Setting,
    cells_of,
    draw_day,
    ridge,
    table_of,
)
from studies.research.benchmarks.few_poses.tables import (
    coverage_table,
    errors_table,
    held_of,
    true_values,
)
from studies.research.withheld.robots import LIGHT

ARMS = {"6R": LIGHT, "7R": SEVEN}
SIZES = (1.0, 10.0)
POSES = (8, 10, 12, 15, 20, 40)
RIDGE = "ridge by CV"
_TURNS = tuple(product((1, 3), (False, True)))  # markers, whether the arm scatters: day by day


def rows_of_day(arm: str, times: float, index: int, seed: int, poses: Sequence[int]) -> list[Row]:
    """What came of the tables of one day."""
    setting = Setting(times, *_TURNS[index % len(_TURNS)])
    day = draw_day(ARMS[arm], setting, index, seed)
    cells = cells_of(day)
    truth = {way: true_values(cell, day) for way, cell in cells.items()}
    return [
        {"arm": arm, **asdict(setting), "day": index, "poses": n} | _one_table(day, n, cells, truth)
        for n in poses
    ]


def _one_table(day: Day, n: int, cells: dict[str, calib.Cell], truth: dict[str, Array]) -> Row:
    """Errors, None where there is no answer, and claims that hold, by estimator."""
    exact, there = day.points(day.held), poses_at(day.held)
    data = table_of(day.q[:n], day.read[:n])
    errors: dict[str, float | None] = {}
    claims: Row = {}
    for way, cell in cells.items():
        try:
            found = calib.identify(cell, data)
        except calib.CalibError:
            errors[way] = None
            continue
        errors[way] = rms_3d(found.predict(there) - exact)
        claims[way] = held_of(found, truth[way])
    model = build(cells[DEFAULT], data.poses).model
    values = ridge(model, data, SIGMA, np.random.default_rng(n))
    errors[RIDGE] = rms_3d(model.predict(values, there) - exact)
    return {"errors_m": errors, "intervals": claims}


@bench(
    several("--arm", tuple(ARMS)),
    several("--poses", POSES),
    days=40,
    days_help="Of each arm and size of errors; four take turns with all conditions.",
    workers=True,
)
def main(
    days: int, arm: tuple[str, ...], poses: tuple[int, ...], seed: int, workers: int
) -> Output:
    """Identify from few poses, and hold errors and claims against the truth."""
    tasks = product(arm, SIZES, range(days))
    rows = [row for own in each(rows_of_day, tasks, workers, seed=seed, poses=poses) for row in own]
    shown = ["Held-out error, 3-D RMS", table(errors_table(rows))]
    shown += ["\nWhat holds of what was said", table(coverage_table(rows))]
    return shown, {"seed": seed, "tables": rows}


if __name__ == "__main__":
    main()
