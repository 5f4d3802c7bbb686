"""Days without a mistake, by numpy alone: whatever is called one of them is a false alarm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
from calib.arrays import Array
from calib.errors import CalibError, InputError
from calib.identification.mistakes import recognised
from calib.identification.start import initial_values
from calib.model.build import build
from calib.threads import one_blas_thread
from studies.research.bench import data_folder
from studies.research.benchmarks.day import cell_text, placement
from studies.research.fuzz_days.day import draw_arm, draw_joints
from studies.research.withheld.robots import Arm
from studies.research.withheld.truth import tip_in_numpy, urdf

_LONGEST_LINK = 0.1  # m, by which a link may differ from its model


@one_blas_thread
def drawn(index: int, seed: int = 0) -> tuple[str, list[str]]:
    """What a day is called, and its false alarms.

    Every third day has one link up to 0.1 m off; every second comes to each pose again, with new noise;
    digits are as fine as the noise, or up to a thousand times finer; one day of ten has no noise.
    """
    rng = np.random.default_rng([seed, index])
    arm = draw_arm(rng)
    poses, markers = int(rng.integers(6, 61)), int(rng.integers(1, 5))
    motion = "narrow" if rng.random() < 0.1 else "free"
    q = draw_joints(rng, arm, motion, poses)
    if index % 2:
        q = np.concatenate([q, q[: poses // 2]])
    errors = rng.normal(size=(arm.dof + 2, 6)) * 10.0 ** rng.uniform(-5.0, -2.5)
    if index % 3 == 0:
        along = rng.normal(size=3)
        link = int(rng.integers(1, arm.dof + 1))
        errors[link, :3] += rng.uniform(0.0, _LONGEST_LINK) * along / np.linalg.norm(along)
    sigma = 10.0 ** rng.uniform(-6.0, -4.0)
    places = rng.normal(scale=arm.tool, size=(markers, 3))
    R, p = tip_in_numpy(arm, q, errors)
    turn, shift = placement(rng)
    points = (p[:, None] + places @ R.transpose(0, 2, 1)) @ turn.T + shift
    loud = 0.0 if rng.random() < 0.1 else float(rng.choice([0.3, 1.0, 1.0, 3.0]))
    points = points + rng.normal(size=points.shape) * sigma * loud
    digits = int(np.ceil(-np.log10(1e3 * sigma))) + int(rng.integers(0, 4))
    name = f"{arm.name}, {len(q)} readings, {markers} markers"
    with TemporaryDirectory() as folder:
        _write(Path(folder), arm, q, points, places, sigma, digits)
        return name, alarms(
            Path(folder) / "cell.toml", Path(folder) / "measurements.csv", loud > 0.0
        )


def _write(
    folder: Path, arm: Arm, q: Array, points: Array, places: Array, sigma: float, digits: int
) -> None:
    joints = [f"{j.name}_{'mm' if j.slides else 'deg'}" for j in arm.joints]
    shown = q * np.where(arm.slides, 1e3, 180.0 / np.pi)
    rows = [",".join(["pose", "marker", *joints, "x_mm", "y_mm", "z_mm"])]
    for i, (own, read) in enumerate(zip(shown, points * 1e3, strict=True)):
        for j, point in enumerate(read, 1):
            values = [*(f"{x:.7f}" for x in own), *(f"{x:.{digits}f}" for x in point)]
            rows.append(",".join([f"p{i:03d}", f"m{j}", *values]))
    (folder / "measurements.csv").write_text("\n".join([*rows, ""]), encoding="utf-8")
    (folder / "robot.urdf").write_text(urdf(arm, masses=False), encoding="utf-8")
    (folder / "cell.toml").write_text(cell_text("day", arm, places, sigma), encoding="utf-8")


def alarms(cell_path: Path, table: Path, noisy: bool = True) -> list[str]:
    """What a healthy table is called, with every pose taken for far off as well.

    noisy : whether readings have noise; without it a reading that is equal to another is no new one
    """
    found = []
    cell = calib.load_cell(cell_path)
    data = calib.load_measurements(cell, table, every_marker=False)
    found += [w for w in data.warnings if "to the last digit" in w and noisy]
    try:
        model = build(cell, data.poses).model
        tracked = model.tracked(data)
        if tracked is None:
            return found
        model, data = tracked
        off = model.off(initial_values(model, data), data)
        missed = np.sqrt((off**2).sum(axis=(1, 2)) / np.maximum(data.seen.sum(axis=1), 1))
        mistakes = {recognised(model, data, own) for own in (missed, np.full(len(data), np.inf))}
        found += [own.text for own in mistakes if own is not None]
    except CalibError:
        pass  # too few poses for this model: nothing is recognised
    return found


def real() -> Iterator[tuple[str, list[str]]]:
    """The real days at hand, each with what it is called."""
    try:
        folder = data_folder()
    except InputError:
        return  # drawn days are asked without them
    for cell in sorted(folder.glob("**/*.toml")):
        for table in sorted(cell.parent.glob("*.csv")):
            name = f"{cell.parent.name}/{table.name}"
            try:
                yield name, alarms(cell, table)
            except CalibError as error:
                yield name, [] if "joint" in str(error) else [str(error)]
