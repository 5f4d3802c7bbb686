"""Real arms: the error at poses that took no part, as the robot's file has them, identified, diagnosed.

    python -m studies.research.real [--splits 3] [--workers 2] [--json FILE]

Nominal is the robot's file with base and tool fitted. Of each set three tenths of the configurations
are held out, drawn by seeds 0, 1, ..; of TIAGo the session that FIGAROH's authors kept for validation.
Errors are 3-D RMS per point, mm, medians over the splits.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

import calib
from calib.errors import CalibError
from studies.research.bench import Output, Row, bench, count, data_folder, each, rms_3d, table

HELD_OUT = 0.3
SETS = {
    "ABB IRB120, FARO tracker": "irb120_faro cell.toml measurements.csv",
    "UR10, Leica tracker": "ur10_leica_b cell.toml measurements.csv",
    "Meca500, tracker": "meca500_right80 cell.toml measurements.csv",
    "FANUC R-2000, tracker": "fanuc_r2000 cell.toml measurements.csv",
    "Hilti column, total station": "hilti_column cell.toml flat.csv",
    "TIAGo, Qualisys": "tiago cell.toml measurements.csv validation.csv",
}


def one_split(name: str, seed: int) -> Row:
    """Held-out errors of a set, mm."""
    folder, *files = SETS[name].split()
    path = data_folder(folder)
    cell = calib.load_cell(path / files[0])
    data = calib.load_measurements(cell, path / files[1])
    if len(files) > 2:
        kept, held = data, calib.load_measurements(cell, path / files[2])
    else:
        kept, held = data.split(HELD_OUT, np.random.default_rng(seed))
    models = {"nominal": replace(cell, effects=("base", "tool")), "identified": cell}
    found: Row = {}
    for model, own in models.items():
        result = calib.identify(own, kept, heldout=held)
        if result.heldout is not None:
            found[model] = 1e3 * rms_3d(result.heldout.vectors[held.seen])
    try:
        after = calib.diagnose(cell, kept, heldout=held).gap.heldout_after
    except CalibError:  # the table says how many of the splits are not answered
        after = None
    return {**found, "diagnosed": np.nan if after is None else 1e3 * after}


@bench(count("--splits", 3), workers=True)
def main(splits: int, seed: int, workers: int) -> Output:
    """Held-out errors of six real arms."""
    fixed = {name for name, files in SETS.items() if "validation" in files}
    drawn = product(SETS, range(seed, seed + splits))
    tasks = [(name, k) for name, k in drawn if k == seed or name not in fixed]
    found = dict(zip(tasks, each(one_split, tasks, workers), strict=True))
    rows = []
    for name in SETS:
        own = [found[task] for task in tasks if task[0] == name]
        medians = {model: float(np.nanmedian([row[model] for row in own])) for model in own[0]}
        unanswered = int(np.isnan([row["diagnosed"] for row in own]).sum())
        counts = {"splits": len(own), "not diagnosed": unanswered}
        rows.append({"robot, instrument": name, **counts, **medians})
    shown = [{k: f"{v:.3g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows]
    return [table(shown)], rows


if __name__ == "__main__":
    main()
