"""From which amplitude on a gear ripple is found, and what a known gear ratio gains.

    python -m studies.research.benchmarks.ripple [--days 20] [--amplitude 10] .. [--workers 2]
        [--json FILE]

Days are those of ``benchmarks.days`` (60 poses, three markers, an arm that repeats to 5 um),
and one joint of the arm ripples besides: the truth is MuJoCo's, at joints that were bent before. It is
found where the ripple is named at its joint within two widths of a line of its cycles. A person sees it
where its line is the highest in the spectrum of the residual along the joint's axis, by half and more.
The cell gives the gear ratio or does not. In theory a line is found half the time where its fall equals
its price, of which the ratio saves ``2 log`` of the tunings that need not be tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

import calib
from calib.arrays import Array
from calib.diagnosis.spectra import spectra
from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.diagnose.make import findings
from studies.research.benchmarks.day import Setting, draw_day, write_day
from studies.tables import plain_table

JOINT, RATIO = 2, 100.0
_SETTING = Setting("6R", 5e-6, 1, 60, 3)
_AMPLITUDES = (0, 10, 15, 20, 25, 30, 40, 60)  # urad
_STANDS_OUT = 1.5  # times the next line's amplitude
_ROUNDED = 2.0  # widths of a line


@dataclass(frozen=True)
class Ripple:
    """``amplitude cos(cycles q - phase)`` of one joint, rad."""

    amplitude: float
    phase: float

    def __call__(self, q: Array) -> Array:
        """Where the joints truly stand."""
        bent = q.copy()
        bent[:, JOINT] += self.amplitude * np.cos(2.0 * RATIO * q[:, JOINT] - self.phase)
        return bent


@one_blas_thread
def one_day(amplitude: float, index: int, seed: int) -> dict[str, Any]:
    """Whether the ripple of one day is seen and found, without and with its ratio."""
    phase = float(np.random.default_rng([seed, index]).uniform(0.0, 2.0 * np.pi))
    day = draw_day(_SETTING, index, seed, Ripple(amplitude * 1e-6, phase))
    joint = day.arm.joints[JOINT].name
    found: dict[str, Any] = {"amplitude_urad": amplitude, "day": index}
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, day)
        cell = folder / "cell.toml"
        text = cell.read_text(encoding="utf-8")
        for key, more in (("plain", ""), ("known", f"[robot.gear_ratio]\n{joint} = {RATIO:g}\n")):
            cell.write_text(text + more, encoding="utf-8")
            fields = _diagnosed(folder)
            found[key] = _named(fields, joint, _width(day.q))
            if key == "plain":
                found["seen"] = _seen(fields, joint, _width(day.q))
    return found


def _diagnosed(folder: Path) -> dict[str, Any]:
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    found = calib.diagnose(cell, data)
    return findings(found, spectra(found)).model_dump(mode="json", by_alias=True)


def _width(q: Array) -> float:
    return 2.0 * np.pi / float(np.ptp(q[:, JOINT]))


def _named(fields: dict[str, Any], joint: str, width: float) -> bool:
    ripples = [
        parameter["value"]
        for e in fields["effects"]
        if e["effect"] == "gear_ripple" and e["where"] == joint
        for parameter in e["parameters"]
        if parameter["name"] == "cycles"
    ]
    return any(abs(c - 2.0 * RATIO) < _ROUNDED * width for c in ripples)


def _seen(fields: dict[str, Any], joint: str, width: float) -> bool:
    """Whether its line is the highest of the plain spectrum, by half of the next one's amplitude."""
    own = next(s for s in fields["spectra"] if s["joint"] == joint)
    cycles, amplitude = np.array(own["cycles_1_turn"]), np.sqrt(np.array(own["fall"]))
    at = np.abs(cycles - 2.0 * RATIO) < _ROUNDED * width
    others = amplitude[~at & (cycles > 15.0)]
    return bool(amplitude[at].max() > _STANDS_OUT * others.max())


@click.command(help=__doc__.split("\n\n")[0] if __doc__ else None)
@click.option("--days", type=click.IntRange(min=1), default=20, show_default=True)
@click.option("--amplitude", "amplitudes", type=float, multiple=True, default=_AMPLITUDES,
              show_default=True, help="urad")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All days.")
@one_line_faults
def main(
    days: int, amplitudes: Sequence[float], seed: int, workers: int, json_path: Path | None
) -> None:
    """Count how often each amplitude is seen and found."""
    tasks = list(product(amplitudes, range(days)))
    with ProcessPoolExecutor(workers) as pool:
        found = list(pool.map(partial(one_day, seed=seed), *zip(*tasks, strict=True)))
    table = plain_table(
        ("ripple\n[urad]", "right"), ("\ndays", "right"),
        ("a person\nsees it", "right"), ("named", "right"), ("named, gear\nratio known", "right"),
    )  # fmt: skip
    for amplitude in amplitudes:
        own = [d for d in found if d["amplitude_urad"] == amplitude]
        counts = [str(sum(d[key] for d in own)) for key in ("seen", "plain", "known")]
        table.add_row(f"{amplitude:g}", str(len(own)), *counts)
    console_for(None).print(table)
    if json_path is not None:
        write_files({json_path: json_text({"seed": seed, "days": found})})


if __name__ == "__main__":
    main()
