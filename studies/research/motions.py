"""Held-out torque errors of real arms, and the terms that are named.

    python -m studies.research.motions [--choices 10] [--json FILE]

Of the UR10e's eleven runs eight are fitted and three held out: first those that are named in
``HELD_OUT``, then choices drawn by seeds. Of the KR300's two runs each is held out, then none: what
was found of both is fitted to each and predicts the other. Errors are
RMS in percent of the torque's RMS, quadratic mean over joints.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
from calib.files.motions import load_motions
from calib.motion.diagnose import TorqueGap
from calib.motion.motions import Motions
from studies.research.bench import Output, Row, bench, clocked, count, data_folder, table

HELD_OUT = ("free_h8", "free_h12_30s", "free_jan")
_SETS = {
    "UR10e": ("ur10e_motion", "base_link", "tool0", 8),
    "KR300": ("kr300_motion", "base", "link6", 10),
}
_CELL = """schema = 1
[robot]
urdf = "{}"
base = "{}"
tip = "{}"
[motion]
cutoff_hz = {}
"""


def read(name: str) -> tuple[calib.Cell, Motions]:
    """The cell and the runs of a set. Raises InputError where it is not there."""
    folder, *more = _SETS[name]
    with TemporaryDirectory() as place:
        path = Path(place) / "cell.toml"
        path.write_text(_CELL.format(data_folder(folder) / "robot.urdf", *more), encoding="utf-8")
        cell = calib.load_cell(path)
    return cell, load_motions(cell, data_folder(folder) / "motion.csv")


def one_choice(cell: calib.Cell, motions: Motions, held: tuple[str, ...] = ()) -> Row:
    """Errors in percent before and after, CPU seconds, and at how many joints each term is."""
    kept = motions.take([name for name in motions.names if name not in held])
    apart = motions.take(held) if held else None
    found, seconds = clocked(lambda: calib.diagnose(cell, kept, heldout=apart))
    gap, kinds = found.gap, Counter(cause.effect for cause in found.causes)
    return {
        "held out": ", ".join(held) or "in turn",
        "before": f"{100.0 * TorqueGap.overall(gap.before):.1f}",
        "after": f"{100.0 * TorqueGap.overall(gap.after):.2f}",
        "moving": f"{100.0 * TorqueGap.overall(gap.moving):.2f}",
        "CPU s": f"{seconds:.1f}",
        "terms": ", ".join(f"{kind} {n}" for kind, n in sorted(kinds.items())),
    }


@bench(count("--choices", 10))
def main(choices: int, seed: int) -> Output:
    """Held-out torque errors of real arms."""
    cell, motions = read("UR10e")
    rng, rows = np.random.default_rng(seed), []
    drawn = [
        HELD_OUT,
        *(tuple(rng.choice(motions.names, 3, replace=False)) for _ in range(choices - 1)),
    ]
    rows += [{"robot": "UR10e", **one_choice(cell, motions, tuple(map(str, own)))} for own in drawn]
    cell, motions = read("KR300")
    rows += [
        {"robot": "KR300", **one_choice(cell, motions, held)}
        for held in (*((n,) for n in motions.names), ())
    ]
    return [table(rows)], rows


if __name__ == "__main__":
    main()
