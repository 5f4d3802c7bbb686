"""Held-out errors of public measurements of real arms: nominal, identified, diagnosed.

    python -m studies.research.real [--splits 3] [--only "TIAGo, Qualisys"] [--workers 2] [--json FILE]

Nominal is the robot's file with base and tool fitted. Of each set three tenths of the configurations
are held out, drawn by seeds 0, 1, ..; of TIAGo the session that FIGAROH's authors kept for validation.
Errors are 3-D RMS per point, mm, or px where a camera reads alone; medians over the splits, and the
largest. CPU of the diagnosis is in that of ``identify`` of the same readings, in the same run.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

import calib
from calib.errors import CalibError
from studies.research.bench import (
    Output,
    Row,
    bench,
    clocked,
    count,
    data_folder,
    each,
    real_data,
    several,
    table,
)

HELD_OUT = 0.3
SETS = {
    "ABB IRB120, FARO tracker": "irb120_faro cell.toml measurements.csv",
    "UR10, Leica tracker": "ur10_leica_b cell.toml measurements.csv",
    "Meca500, tracker": "meca500_right80 cell.toml measurements.csv",
    "FANUC R-2000, tracker": "fanuc_r2000 cell.toml measurements.csv",
    "Hilti column, total station": "hilti_column cell.toml flat.csv",
    "TIAGo, Qualisys": "tiago cell.toml measurements.csv validation.csv",
    "Hilti column on a seesaw": "hilti_column cell.toml seesaw.csv",
    "ABB IRB120, Wu and others": "irb120_wu2015 cell.toml measurements.csv",
    "KUKA iiwa 7, tracker": "iiwa7_torque cell.toml measurements.csv",
    "Positioner, poses": "positioner_poses cell.toml measurements.csv",
    "Panda, sockets": "panda_sockets_2 cell.toml measurements.csv",
    "Yaskawa MA1400, cameras": "ma1400_cameras cell.toml measurements.csv",
}
_FIXED = {name for name, files in SETS.items() if "validation" in files}
_MODELS = ("nominal", "identified", "diagnosed")


def one_split(name: str, seed: int) -> Row:
    """Held-out errors of a set, mm or px, and CPU seconds."""
    folder, *files = SETS[name].split()
    cell, data = real_data(folder, *files[:2])
    if name in _FIXED:
        kept, held = data, calib.load_measurements(cell, data_folder(folder) / files[2])
    else:
        kept, held = data.split(HELD_OUT, np.random.default_rng(seed))
    nominal = calib.identify(replace(cell, effects=("base", "tool")), kept, heldout=held)
    identified, seconds = clocked(lambda: calib.identify(cell, kept, heldout=held))
    _, unit, scale = identified.model.readout.channels.shown
    row: Row = {"unit": unit, "diagnosed": np.nan, "verdict": "", "times identify": np.nan}
    for model, result in (("nominal", nominal), ("identified", identified)):
        row[model] = np.nan
        if result.heldout is not None:
            squares = (result.heldout.vectors[held.seen] ** 2).sum(axis=-1)
            row[model] = float(np.sqrt(squares.mean())) / scale
    try:
        diagnosed, longer = clocked(lambda: calib.diagnose(cell, kept, heldout=held))
    except CalibError:  # the table says how many of the splits are not answered
        return row
    after = diagnosed.gap.heldout_after
    row["diagnosed"] = np.nan if after is None else after / scale
    return {**row, "verdict": diagnosed.verdict, "times identify": longer / seconds}


@bench(
    count("--splits", 3),
    several("--only", list(SETS), help="Which sets, all by default."),
    workers=True,
)
def main(splits: int, seed: int, only: tuple[str, ...], workers: int) -> Output:
    """Held-out errors of real arms."""
    drawn = product(only, range(seed, seed + splits))
    tasks = [(name, k) for name, k in drawn if k == seed or name not in _FIXED]
    found = dict(zip(tasks, each(one_split, tasks, workers), strict=True))
    shown = []
    for name in only:
        rows = [found[task] for task in tasks if task[0] == name]
        errors = {model: [row[model] for row in rows] for model in _MODELS}
        shown.append(
            {
                "robot, instrument": name,
                "splits": len(rows),
                "not diagnosed": int(np.isnan(errors["diagnosed"]).sum()),
                "unit": rows[0]["unit"],
                **{model: f"{np.nanmedian(values):.3g}" for model, values in errors.items()},
                "at most": f"{np.nanmax(errors['diagnosed']):.3g}",
                "times identify": f"{np.nanmedian([row['times identify'] for row in rows]):.3g}",
            }
        )
    return [table(shown)], [{"set": task[0], "split": task[1], **found[task]} for task in tasks]


if __name__ == "__main__":
    main()
