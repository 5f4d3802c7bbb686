"""The levels of noise as a user reads them, from simulated arms that scatter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from studies.research.benchmarks.day import Setting, draw_day, write_day
from tests.studies.command_line import result


def told(folder: Path, command: str, setting: Setting) -> tuple[dict[str, Any], str]:
    """The fields and the text of one command on a day of an arm in MuJoCo, scattering in its tip."""
    write_day(folder, draw_day(setting, 1, 0))
    day = folder / "cell.toml", folder / "measurements.csv"
    return result(folder / "out.json", command, *day)


def test_poses_that_were_approached_again_tell_the_arm(tmp_path: Path) -> None:
    fields, said = told(tmp_path, "identify", Setting("6R", 3e-5, 2, 25, 3))
    noise = fields["noise"]
    # 3-D RMS of 0.03 mm, new at every approach, and nothing beside it.
    assert noise["repeatability_mm"] == pytest.approx(0.03 / 3**0.5, rel=0.25)
    assert noise["configuration_mm"] < 0.3 * noise["repeatability_mm"]
    assert noise["sigma_mm"] == pytest.approx(0.01, rel=0.2)
    assert "its repeatability" in said
    assert "cannot tell" not in said


def test_without_them_arm_and_model_are_one(tmp_path: Path) -> None:
    fields, said = told(tmp_path, "identify", Setting("6R", 3e-5, 1, 40, 3))
    assert fields["noise"]["repeatability_mm"] is fields["noise"]["repeatability_urad"] is None
    assert fields["noise"]["configuration_mm"] == pytest.approx(0.03 / 3**0.5, rel=0.3)
    assert "cannot tell the arm from the model. Visit some poses again" in said


def test_what_the_cell_says_of_the_arm_is_shown(tmp_path: Path) -> None:
    write_day(tmp_path, draw_day(Setting("6R", 3e-5, 1, 40, 3), 1, 0))
    cell = tmp_path / "cell.toml"
    known = 'tip = "flange"\nrepeatability_mm = 0.0173\nrepeatability_urad = 60'
    text = cell.read_text()
    cell.write_text(text.replace('tip = "flange"', known))
    assert cell.read_text() != text
    fields, _ = result(tmp_path / "out.json", "identify", cell, tmp_path / "measurements.csv")
    noise = fields["noise"]
    assert noise["repeatability_mm"] == pytest.approx(0.0173)
    assert noise["repeatability_urad"] == pytest.approx(60.0)
