"""Bugs put into physics and weights, one at a time: the independent truth must notice each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from calib.arm import statics
from calib.cell import Cell, Repeatability
from calib.instruments.tracker import Tracker
from calib.noise import Noise
from studies.research.truth.arms import HEAVY
from studies.research.truth.day import Setting, draw_day, write_day
from tests.studies.research.sealed.scenes import as_files, case_of, scene_of

Put = Callable[[pytest.MonkeyPatch], None]
_SCATTER = 30e-6 / np.sqrt(3.0)  # m, of one coordinate of the tip


def loads_with(masses: float, gravity: float) -> Put:
    right = statics.loads_of

    def wrong(robot: Any, poses: Any, payload: Any, g: Any) -> Any:
        return right(replace(robot, masses=masses * robot.masses), poses, payload, gravity * g)

    return lambda patch: patch.setattr(statics, "loads_of", wrong)


def torque_too_large(patch: pytest.MonkeyPatch) -> None:
    right = statics.transmitted
    patch.setattr(
        statics, "transmitted", lambda *given: replace(own := right(*given), local=1.3 * own.local)
    )


def weights_times(factor: float) -> Put:
    right = Noise.whitening
    return lambda patch: patch.setattr(Noise, "whitening", lambda *own: factor * right(*own))


def sigma_read_threefold(patch: pytest.MonkeyPatch) -> None:
    right = Tracker.__init__

    def wrong(self: Tracker, sigma: float = 1.0, noise: Noise | None = None, **more: Any) -> None:
        right(self, 3.0 * sigma, noise and Noise.isotropic(3.0 * noise.along), **more)

    patch.setattr(Tracker, "__init__", wrong)


STATICS = {
    "torque x 1.3": torque_too_large,
    "gravity's sign": loads_with(masses=1.0, gravity=-1.0),
    "link masses x 3": loads_with(masses=3.0, gravity=1.0),
}
WEIGHTS = {
    "weights x 3": weights_times(3.0),
    "weights / 1.5": weights_times(1.0 / 1.5),
    "sigma read x 3": sigma_read_threefold,
}


@pytest.mark.parametrize("bug", ["", *STATICS])
def test_statics(bug: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Load, weights and compliances: two programs, one equilibrium, but for the bug."""
    scene = scene_of(HEAVY)
    cell, data = as_files(tmp_path / "case", case := case_of(scene))
    soft = [(name, scene.compliance[scene.index(name)]) for name in scene.modelled]
    values = {f"joint_compliance:{name}.compliance": value for name, value in soft}
    if bug:
        STATICS[bug](monkeypatch)
    off = np.abs(calib.predict(cell, data, values) - case.clean[~scene.session.held]).max()
    assert (off > 1e-5) if bug else (off < 1e-7)


def measured(
    folder: Path, scatter: float, seed: int
) -> tuple[Cell, calib.Measurements, calib.Measurements]:
    folder.mkdir()
    write_day(folder, draw_day(Setting("6R", scatter, 1, 60, 3), 1, seed))
    cell = calib.load_cell(folder / "cell.toml")
    read, exact = (
        calib.load_measurements(cell, folder / f"{n}.csv") for n in ("measurements", "exact")
    )
    return cell, read, exact


@pytest.mark.parametrize("bug", ["", *WEIGHTS])
def test_weights(bug: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The noise of the truth is what the cell says, but for the bug."""
    if bug:
        WEIGHTS[bug](monkeypatch)
    cell, data, _ = measured(tmp_path / "day", 0.0, 0)
    factor = calib.identify(cell, data).noise.factor
    assert (abs(np.log(factor)) > 0.3) if bug else (abs(np.log(factor)) < 0.1)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_scatter_of_the_arm(times: float, tmp_path: Path) -> None:
    """What the cell says of the arm decides how far a result is off in its standard deviations."""
    off = []
    for seed in range(3):
        cell, data, exact = measured(tmp_path / str(seed), 30e-6, seed)
        said = Repeatability(times * _SCATTER, times * _SCATTER / 0.4)
        cell = replace(cell, repeatability=said)
        found, perfect = calib.identify(cell, data), calib.identify(cell, exact)
        free = (found.std > 0.0) & (perfect.std > 0.0)
        off.append(((found.values - perfect.values) / found.std)[free])
    rms = float(np.sqrt(np.mean(np.square(np.concatenate(off)))))
    assert (rms < 0.7) if times > 1.0 else (0.8 < rms < 1.2)
