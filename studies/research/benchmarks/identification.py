"""Identification by posecal and by pybotics 3.1.2 from the same readings of a real UR10.

    python -m studies.research.benchmarks.identification [--json FILE]

The first 100 and 300 poses are fitted, those after the first 300 held out. pybotics sees one marker,
so posecal is run with all three and with that one alone. Timed is the solve, posecal's with initial
values, outliers and covariance. pybotics is given:

- the URDF's nominal arm as an MDH chain, checked, and as a start posecal's first estimate of base and
  marker, whose time is not counted: pybotics has none of its own;
- masks that free no redundant parameter: with all 33 free it was slower to every level of error;
- SciPy's ``trf``: ``lm`` was mostly slower, ``dogbox`` stuck. Its residual is the length of each error,
  without direction, so steps gain little: ``x_scale="jac"`` creeps on to the cap, SciPy's default
  stops early. Both are shown, and the time to within 5 % of posecal's error, free of stopping rules;
- in one variant, fixed links between parallel joints: MDH cannot tilt one of two parallel axes within
  their plane, and pybotics can mend that so by its own means.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Column, Table
from scipy.optimize import least_squares

import calib
from calib import Cell, Identification, Measurements
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import so3_exp, transform
from calib.arrays import Array
from calib.effects.base import Base
from calib.files.write import json_text, write_files
from calib.identification.start import initial_values
from calib.model.build import build
from studies.command.options import one_line_faults
from studies.research.benchmarks.real import folder_of, read

SIZES, HELD_FROM = (100, 300), 300
CLOSE = 1.05  # share of posecal's error at which pybotics is clocked
POSES_EVALUATED = 60_000  # cap, max_nfev times poses: one to three minutes a run
VARIANTS: dict[str, tuple[bool, Any]] = {  # auxiliary links, SciPy's x_scale
    "6 links, x_scale 1": (False, 1.0),
    "6 links, x_scale jac": (False, "jac"),
    "6 + 2 links, x_scale jac": (True, "jac"),
}
Row = dict[str, Any]  # heading -> figure; errors are 3-D RMS per point, of the first marker or all


def rms(lengths: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(lengths**2)))


def mdh_chain(robot: Robot, auxiliary: bool) -> tuple[Array, Array, list[int]]:
    """Modified DH links ``Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`` of the nominal arm, L of them.

    auxiliary : put a fixed link before each joint that is parallel to the one before it

    Returns alpha [rad], a [mm], theta [rad], d [mm], shape (L, 4); which of them to identify: base
    and tool stand for the first link and the last theta and d, of parallel joints one d acts; the
    joint that turns each link, -1 where none does.
    """
    tilt = np.arctan2(robot.origins[:, 2, 1], robot.origins[:, 1, 1])
    parallel = np.abs(tilt) < 1e-6
    links = []
    for k in range(robot.dof):
        a, d = 1e3 * robot.origins[k, 0, 3], 1e3 * robot.origins[k + 1, 2, 3]
        inner = 0 < k < robot.dof - 1
        values, free = [tilt[k], a, 0.0, d], [k > 0, k > 0, inner, inner and not parallel[k + 1]]
        if auxiliary and k > 0 and parallel[k]:
            # The theta of the fixed link is the tilt that MDH lacks.
            links.append(([np.pi / 2, a, 0.0, 0.0], [True, True, True, False], -1))
            values[:2], free[:2] = [-np.pi / 2, 0.0], [False, False]
        links.append((values, free, k))
    rows, mask, joint = zip(*links, strict=True)
    return np.array(rows), np.array(mask), list(joint)


def pybotics_handler(cell: Cell, data: Measurements, q: Array, rows: Array, free: Array) -> Any:
    """pybotics' handler at posecal's first estimate of base and marker, mm and rad.

    q : ndarray, shape (m, L), rad, of each link at each pose
    Raises CalibError where the nominal arms differ by more than 1e-6 mm at one of the poses.
    """
    from pybotics.optimization import OptimizationHandler
    from pybotics.robot import Robot as MDHRobot

    robot = MDHRobot.from_parameters(rows)
    frames = forward(cell.robot, data.poses.q)
    tips = transform(frames.R[:, -1], 1e3 * frames.o[:, -1])
    if np.abs(np.array([robot.fk(angles) for angles in q]) - tips).max() > 1e-6:
        raise calib.CalibError("the MDH chain differs from the URDF; are its origins Rx Tx Tz?")
    model = build(cell, data.poses).model
    start = initial_values(model, data)
    base = start[model.where(Base)]
    robot.world_frame = transform(so3_exp(base[3:]), 1e3 * base[:3])
    robot.tool.position = 1e3 * model.marker_positions(start)[0]
    return OptimizationHandler(robot, free.ravel(), [True] * 3 + [False] * 3, [True] * 6)


def solve_pybotics(
    cell: Cell, data: Measurements, heldout: Measurements, variant: str, posecal_mm: float
) -> Row:
    """Fit the only marker of ``data``, and note when the error first came close to posecal's."""
    from pybotics.optimization import compute_absolute_errors, optimize_accuracy

    auxiliary, x_scale = VARIANTS[variant]
    rows, free, joint = mdh_chain(cell.robot, auxiliary)
    (q, points), held = (
        (np.insert(d.poses.q, cell.robot.dof, 0.0, axis=1)[:, joint], 1e3 * d.points[:, 0])
        for d in (data, heldout)
    )
    handler = pybotics_handler(cell, data, q, rows, free)
    start = handler.generate_optimization_vector()
    close: list[float] = []

    def clocked(vector: Array) -> Array:
        errors: Array = optimize_accuracy(vector, handler, q, points)
        if not close and rms(errors) <= CLOSE * posecal_mm:
            close.append(time.perf_counter() - begun)
        return errors

    begun = time.perf_counter()
    cap = POSES_EVALUATED // len(data)
    found = least_squares(clocked, start, method="trf", x_scale=x_scale, max_nfev=cap)
    seconds = time.perf_counter() - begun
    handler.apply_optimization_vector(found.x)
    return {
        "program": "pybotics" + (", capped" if found.status == 0 else ""),
        "variant": variant,
        "free": len(start),
        "solve [s]": seconds,
        "to 5 % [s]": close[0] if close else None,
        "fitted [mm]": rms(found.fun),
        "held out [mm]": rms(compute_absolute_errors(*held, handler.robot)),
        "all markers [mm]": None,
    }


def timed(cell: Cell, data: Measurements, runs: int) -> tuple[Identification, float]:
    """Result and median seconds of ``calib.identify``, after one run to warm up."""
    seconds = []
    for fresh in [data.take(slice(None)) for _ in range(runs + 1)]:  # poses remember results
        begun = time.perf_counter()
        result = calib.identify(cell, fresh)
        seconds.append(time.perf_counter() - begun)
    return result, statistics.median(seconds[1:])


def solve_posecal(cell: Cell, data: Measurements, heldout: Measurements) -> Row:
    """Fit all markers of ``data``, median of 5 runs."""
    result, seconds = timed(cell, data, 5)
    fitted, held = (
        1e3 * np.linalg.norm(d.points - result.model.predict(result.values, d.poses), axis=-1)
        for d in (data, heldout)
    )
    return {
        "program": "posecal" + (", not converged" if result.status == "not_converged" else ""),
        "variant": f"{held.shape[1]} of 3 markers",
        "free": result.rank,
        "solve [s]": seconds,
        "to 5 % [s]": None,
        "fitted [mm]": rms(fitted[:, 0]),
        "held out [mm]": rms(held[:, 0]),
        "all markers [mm]": rms(held),
    }


def compare(cell: Cell, data: Measurements) -> Iterator[Row]:
    """Every solve, with times as multiples of posecal's on the same single marker."""
    by_marker = ("marker_names", "markers", "marker_normals", "marker_acceptance")
    alone = replace(cell, **{name: getattr(cell, name)[:1] for name in by_marker})
    single = replace(data, **{k: getattr(data, k)[:, :1] for k in ("points", "seen", "sigma")})
    held, held_single = (d.take(slice(HELD_FROM, None)) for d in (data, single))
    for size in SIZES:
        part = single.take(slice(size))
        like = solve_posecal(alone, part, held_single)
        rows = [solve_posecal(cell, data.take(slice(size)), held), like]
        for variant in VARIANTS if find_spec("pybotics") else ():
            rows.append(solve_pybotics(alone, part, held_single, variant, like["fitted [mm]"]))
        for row in rows:
            for key in ("solve", "to 5 %"):
                seconds = row[f"{key} [s]"]
                row[f"{key} [x posecal]"] = seconds and seconds / like["solve [s]"]
            yield {"poses": size, **row}


def whole_process(folder: Path) -> Row:
    """Wall time and peak memory of ``posecal identify`` on all poses, JSON written.

    To be called first: a child's peak counts what its parent held when it was started.
    """
    import resource  # not on Windows

    run = [sys.executable, "-c", "from studies.cli import main; main()", "identify"]
    run += [str(folder / "cell.toml"), str(folder / "measurements.csv")]
    with tempfile.TemporaryDirectory() as out:
        begun = time.perf_counter()
        subprocess.run([*run, "--json", f"{out}/r"], check=True, stdout=subprocess.DEVNULL)  # noqa: S603
        seconds = time.perf_counter() - begun
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / unit
    return {"posecal identify [s]": seconds, "peak memory [MB]": peak}


def table(rows: list[Row]) -> Table:
    """The solves, units of the headings on a line of their own."""
    columns = (Column(key.replace(" [", "\n["), justify="right") for key in rows[0])
    shown = Table(*columns, box=None, pad_edge=False)
    for row in rows:
        cells = row.values()
        shown.add_row(*(f"{c:.3f}" if isinstance(c, float) else str(c or "") for c in cells))
    return shown


@click.command()
@click.option("--json", "path", type=click.Path(path_type=Path), help="Write the figures as JSON.")
@one_line_faults
def main(path: Path | None) -> None:
    """Compare identification by posecal and by pybotics; the latter takes some minutes."""
    whole = whole_process(folder_of("ur10_leica_b"))
    cell, data = read("ur10_leica_b")
    whole |= {"calib.identify [s]": timed(cell, data, 3)[1], "poses": len(data)}
    rows = list(compare(cell, data))
    console = Console(width=140, highlight=False, markup=False)
    console.print(table(rows), "x posecal: in multiples of its solve with one marker", sep="\n")
    console.print("3 markers:", ", ".join(f"{key} {value:.4g}" for key, value in whole.items()))
    if not find_spec("pybotics"):
        console.print("for pybotics: pip install '.[bench]'")
    if path is not None:
        write_files({path: json_text({"rows": rows, "all_poses": whole})})


if __name__ == "__main__":
    main()
