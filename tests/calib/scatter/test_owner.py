"""Whose it is that a fit leaves from pose to pose, on arms in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.prediction.budget import budget_of
from calib.prediction.estimate import estimate_of
from calib.scatter import Variances, parted, pose_to_pose
from studies.research.truth.day import Setting, draw_day, write_day


def _gear(size: float) -> Callable[[Array], Array]:
    """A shoulder that errs 30 times a turn, rad."""

    def truth(q: Array) -> Array:
        return np.asarray(q + size * np.sin(30.0 * q[:, 1:2]) * (np.arange(q.shape[1]) == 1))

    return truth


@pytest.mark.parametrize(
    ("scatter", "approaches", "gear", "of"),
    [
        (3e-5, 1, 0.0, "undecided"),  # as arms of this size may repeat: nothing tells it
        (3e-5, 2, 0.0, "arm"),
        (1e-5, 2, 1e-4, "model"),  # re-approaches tell the arm: what is beside it is the model's
        (1e-5, 1, 6e-4, "model"),  # no arm of this size repeats so badly
    ],
)
def test_whose_it_is(tmp_path: Path, scatter: float, approaches: int, gear: float, of: str) -> None:
    write_day(tmp_path, draw_day(Setting("6R", scatter, approaches, 30, 3), 1, 0, _gear(gear)))
    cell = calib.load_cell(tmp_path / "cell.toml")
    found = calib.identify(cell, calib.load_measurements(cell, tmp_path / "measurements.csv"))
    judged = pose_to_pose(found.levels, found.scatter, cell.robot.reach)
    assert judged.of == of
    assert (judged.arm is None) == (approaches == 1)
    targets, weights = calib.load_targets(cell, tmp_path / "targets.csv")
    known = estimate_of(found)
    parts = budget_of(found, known, targets, weights).parts
    sizes = {part.source: float(np.sqrt((part.errors**2).mean())) for part in parts}
    misfit = sizes.get("what the model lacks, from the fitted poses", 0.0)
    assert (misfit > 0.0) == (of == "model")
    # RMS by which a gear error of the shoulder moves points about a metre away.
    assert misfit <= 1.5 * gear
    arm = sizes.get("repeatability of the arm", sizes.get("arm or model, from pose to pose", 0.0))
    assert arm == pytest.approx(scatter if approaches == 2 or not gear else 0.0, rel=0.4)


def test_parts_are_the_whole() -> None:
    whole = Variances(1.2, np.arange(8.0), np.arange(8.0)[::-1].copy())
    for of in ("model", "undecided", "arm"):
        own, lacks = parted(whole, of)
        np.testing.assert_array_equal(own.approach + lacks.approach, whole.approach)
        np.testing.assert_array_equal(own.configuration + lacks.configuration, whole.configuration)
        assert lacks.any == (of == "model")


def test_without_levels_the_instrument_is_all_that_errs() -> None:
    judged = pose_to_pose(None, None, 1.3)
    assert (judged.of, judged.arm, judged.rest) == ("instrument", None, None)
    assert judged.usual == usual_repeatability(1.3)
