"""Identification from readings of every kind, on real data: nominal, fitted, held out.

    python -m studies.research.benchmarks.instruments [--splits 10] [--only NAME ..] [--images 500]

Each set under ``POSECAL_DATA`` that no tracker read is identified with three tenths of its
configurations held out, drawn by seeds 0, 1, ..; medians over them, in each unit that its instruments
have. ``--images``: so many simulated images of a board of 40 corners instead, identified once; seconds
and largest memory.
"""

from __future__ import annotations

import resource
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import numpy as np

import calib
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from studies.demo.embedded import embedded_text
from studies.research.bench import (
    Output,
    Row,
    bench,
    cell_from,
    clocked,
    count,
    data_folder,
    each,
    table,
)

HELD_OUT = 0.3
SETS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("fr3_eye_in_hand", ()),
    ("positioner_poses", ()),
    ("panda_sockets_2", ()),
    ("iiwa7_torque", ()),
    ("iiwa7_torque", ("measured_torque",)),
    ("ma1400_cameras", ()),
)
"""Folder, and what is identified beside the cell's own effects."""
_CAMERA = """
[boards.b]
on = "tip"
squares = [9, 6]
pitch_mm = 30
position_mm = [200, -100, 0]

[instruments.cam]
kind = "camera"
focal_px = 2400
center_px = [2000, 1500]
sigma_px = 0.2
position_mm = [4000, 0, 1500]
rpy_deg = [-90, 0, 90]

[model]
effects = ["base", "tool", "geometry"]
"""


def rows_of(folder: Path, more: tuple[str, ...], splits: int) -> list[Row]:
    """A row for each instrument and unit: medians over the splits."""
    cell = calib.load_cell(folder / "cell.toml")
    cell = replace(cell, effects=(*cell.effects, *more))
    data = calib.load_measurements(cell, folder / "measurements.csv")
    found: dict[tuple[str, str], list[list[float]]] = {}
    seconds, ranks = [], []
    for seed in range(splits):
        kept, held = data.split(HELD_OUT, np.random.default_rng(seed))
        result, took = clocked(partial(calib.identify, cell, kept, heldout=held))
        seconds.append(took)
        ranks.append(result.rank)
        for key, rms in result.by_instrument.items():
            own = [rms.get(name, np.nan) for name in ("nominal", "fitted_all", "heldout")]
            found.setdefault(key, []).append(own)
    return [
        {
            "data": " + ".join([folder.name, *more]),
            "instrument": instrument,
            "unit": unit,
            **dict(zip(("nominal", "fitted", "held out"), _medians(rms), strict=True)),
            "parameters": f"{np.median(ranks):.0f}",
            "[s]": f"{np.median(seconds):.1f}",
        }
        for (instrument, unit), rms in list(found.items())[:_MOST]
    ]


def _medians(rms: list[list[float]]) -> list[str]:
    return [f"{x:.3f}" for x in np.median(rms, axis=0)]


_MOST = 4  # instruments of one set that are shown: a socket is one


def simulated_images(count: int) -> str:
    """Seconds and memory of one identification of a KR 270 from simulated images."""
    head = 'schema = 1\n[robot]\nurdf = "robot.urdf"\nbase = "base_link"\ntip = "tool0"\n'
    cell = cell_from(head + _CAMERA, embedded_text("kr270.urdf"))
    rng = np.random.default_rng(0)
    home = np.radians([0.0, -60.0, 80.0, 0.0, 30.0, 0.0])
    poses = poses_at(home + rng.uniform(-0.6, 0.6, (count, 6)))
    model = build(cell, poses).model
    placed = [k for k, p in enumerate(model.parameters) if p.effect in ("base", "tool")]
    truth = 0.3 * model.sizes * rng.normal(size=len(model.parameters))
    truth[placed] = model.initial[placed]
    data = drawn_readings(model, truth, poses, None, rng)
    found, seconds = clocked(lambda: calib.identify(cell, data))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    corners = len(model.readout.channels)
    off = (found.values - truth) / np.where(found.std > 0.0, found.std, np.inf)
    missed = float(np.sqrt(np.mean(off**2)))
    return (
        f"{count} images of {corners} corners, {found.rank} parameters: {seconds:.1f} s, at most "
        f"{memory:.0f} MB, {found.status}; off by {missed:.2f} standard deviations RMS"
    )


@bench(
    count("--splits", 10),
    click.option("--only", multiple=True, help="Folders, by their names."),
    click.option("--images", type=click.IntRange(min=20), help="Time simulated images instead."),
    workers=True,
)
def main(splits: int, only: tuple[str, ...], images: int | None, seed: int, workers: int) -> Output:
    """Identify each set, or time simulated images."""
    del seed
    if images is not None:
        return [simulated_images(images)], None
    tasks = [(data_folder(name), more, splits) for name, more in SETS if name in (only or (name,))]
    rows = [row for own in each(rows_of, tasks, workers) for row in own]
    return [table(rows)], rows


if __name__ == "__main__":
    main()
