"""Keys of the cell, and where they arrive in SI units."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import Cell
from calib.noise import Noise
from tests.day import SCARA, file_day
from tests.studies.command_line import paper_cell

SIGMA, MARKER = "sigma_mm = 0.010", "m1 = [279.2, -16.4, -91.9]"
NAN = np.nan
KEYS: list[tuple[str, str, Callable[[Cell], Any], Any]] = [  # words, in their place, where, what
    (SIGMA, "sigma_mm = { range_mm = 0.01, transverse_mm = 0.02 }",
     lambda cell: cell.noise, Noise(1e-5, 2e-5)),
    (SIGMA, "sigma_mm = { range_mm = 0.01, range_mm_per_m = 0.001, transverse_mm = 0.02, "
     "transverse_mm_per_m = 0.006 }", lambda cell: cell.noise, Noise(1e-5, 2e-5, 1e-6, 6e-6)),
    (SIGMA, "sigma_mm = { mpe_mm = 0.02, mpe_mm_per_m = 0.008, divisor = 4 }",
     lambda cell: cell.noise, Noise(5e-6, 5e-6, 2e-6, 2e-6)),
    (MARKER, "m1 = { position = [1, 2, 3], normal = [0, 3, -4], acceptance_deg = 60 }",
     lambda cell: cell.marker_acceptance, [np.pi / 3, NAN, NAN]),
    ("[design]", "[design]\nmargin_mm = 30", lambda cell: cell.design.margin, 0.03),
    ("[model]", "[timing]\nsettle_s = 7\n[model]", lambda cell: cell.pace.settle, 7.0),
    ("[model]", "[robot.torque_constant_Nm_A]\nA2 = 12.5\n[model]",
     lambda cell: cell.motion.constants, {"A2": 12.5}),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "found", "value"), KEYS, ids=[row[1][:40] for row in KEYS])
def test_a_key_arrives(
    old: str, new: str, found: Callable[[Cell], Any], value: Any, tmp_path: Path
) -> None:
    path = paper_cell(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    own = found(calib.load_cell(path))
    own, value = (vars(each) if isinstance(value, Noise) else each for each in (own, value))
    assert own == pytest.approx(value, rel=1e-12, nan_ok=True)


def test_keys_of_joints_that_slide(tmp_path: Path) -> None:
    more = "limits_mm = { Z = [-150, -50] }\nspeed_mm_s = { Z = 400 }\n"
    more += "acceleration_mm_s2 = { Z = 2000 }"
    path = file_day(SCARA, poses=2).written(tmp_path) / "cell.toml"
    path.write_text(path.read_text().replace("[robot]\n", f"[robot]\n{more}\n", 1))
    robot, k = calib.load_cell(path).robot, 2
    assert robot.limits[k] == pytest.approx([-0.15, -0.05])
    assert (robot.speeds[k], robot.accelerations[k]) == pytest.approx((0.4, 2.0))
