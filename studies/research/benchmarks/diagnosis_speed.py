"""What a diagnosis takes, against the number of poses and of candidates.

    python -m studies.research.benchmarks.diagnosis_speed [FOLDER] [--poses 60] .. [--json FILE]

FOLDER holds ``cell.toml`` and ``measurements.csv``; without one it is ``irb120_faro`` under
``POSECAL_DATA``: an arm with a dozen causes. Poses are drawn from its table. Three lineups answer: all
of the catalogue and all curves; without the causes that have a tuning to search; and of those only
what a single joint can do in a constant or a harmonic way. Seconds are those of the processor, one
thread; an identification with the same start is timed beside each, and the ratio to it is what
carries over to other machines.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

import calib
from calib.diagnosis.diagnose import diagnose
from calib.effects import GROUPS, catalogue
from calib.effects.tuned import Tuned
from calib.files.write import json_text, write_files
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.tables import plain_table

_POSES = (60, 130, 300, 700)
_FEW = ("joint_offset", "transmission_harmonic", "transmission_scale", "backlash", "gravity_sag")


def lineups() -> dict[str, tuple[str, ...]]:
    """Kinds that are left out, by the name of the lineup."""
    kinds = {k: effect for k, effect in catalogue().items() if k not in GROUPS}
    tuned = tuple(k for k, effect in kinds.items() if issubclass(effect, Tuned))
    return {"all": (), "no tunings": tuned, "few": tuple(k for k in kinds if k not in _FEW)}


def timed(cell: calib.Cell, data: calib.Measurements) -> dict[str, Any]:
    """Seconds of a diagnosis and of an identification, and how many candidates were asked."""
    begun = time.process_time()
    found = diagnose(cell, data)
    middle = time.process_time()
    calib.identify(cell, data)
    return {
        "poses": len(data),
        "candidates": len(found.suspects),
        "causes": len(found.outcome.active),
        "seconds": middle - begun,
        "identify_seconds": time.process_time() - middle,
    }


@click.command(help=__doc__.split("\n\n")[0] if __doc__ else None)
@click.argument("folder", required=False, type=click.Path(path_type=Path, exists=True))
@click.option(
    "--poses", type=click.IntRange(min=20), multiple=True, default=_POSES, show_default=True
)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All runs.")
@one_line_faults
def main(folder: Path | None, poses: tuple[int, ...], json_path: Path | None) -> None:
    """Time every lineup at every number of poses."""
    folder = folder or Path(os.environ.get("POSECAL_DATA", ".")) / "irb120_faro"
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    order = np.random.default_rng(0).permutation(len(data))
    table = plain_table(
        ("\nlineup", "left"), ("\nposes", "right"), ("\ncandidates", "right"), ("\ncauses", "right"),
        ("diagnose\n[s]", "right"), ("identify\n[s]", "right"), ("\nratio", "right"),
    )  # fmt: skip
    runs = []
    for name, excluded in lineups().items():
        asked = replace(cell, excluded=(*cell.excluded, *excluded))
        for count in poses:
            own = timed(asked, data.take(np.sort(order[:count])))
            runs.append({"lineup": name, **own})
            seconds, alone = own["seconds"], own["identify_seconds"]
            table.add_row(
                name, str(own["poses"]), str(own["candidates"]), str(own["causes"]),
                f"{seconds:.1f}", f"{alone:.2f}", f"{seconds / alone:.0f}",
            )  # fmt: skip
    console_for(None).print(table)
    if json_path is not None:
        write_files({json_path: json_text({"runs": runs})})


if __name__ == "__main__":
    main()
