"""A plant whose robots are read by cameras: pixels are told in mm at the points."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

from tests.camera_days import SETUPS, SIGMA_PX, Truth, kr270_day
from tests.studies.command_line import checked, run


@pytest.mark.parametrize(
    ("setup", "again"),
    [
        ("kr270, two", ("--only", "identify")),
        pytest.param("kr270", (), marks=pytest.mark.long),
    ],
)
def test_robots_that_cameras_read(tmp_path: Path, setup: str, again: tuple[str, ...]) -> None:
    plant, rng = tmp_path / "plant", np.random.default_rng(0)
    for k in range(3):
        (plant / f"r{k}").mkdir(parents=True)
        truth = Truth(3e-4 * rng.normal(size=6), seed=k, stands=k, grows=False)
        kr270_day(plant / f"r{k}", SETUPS[setup], truth, 26)
    out, prior = tmp_path / "plant.json", tmp_path / "type.json"
    asked = ("--workers", 1, "--holdout", 0.2, "--prior", prior, "--json", out, *again)
    done = run("fleet", plant, *asked)
    assert done.exit_code == 0, done.output
    fields = json.loads(out.read_text())
    checked(fields, "fleet")
    assert "3 tables of 3 robots done" in done.output
    alone = setup != "kr270"
    assert (
        "Where cameras alone read, mm are those of pixels at the points." in done.output
    ) == alone
    for own in fields["sessions"]:
        assert own["fault"] is None
        assert own["rms_mm"]["fitted"] < own["rms_mm"]["nominal"]
        if alone:
            noise = np.sqrt(2.0) * SIGMA_PX * own["pixel_mm"]
            assert own["rms_mm"]["fitted"] == pytest.approx(noise, rel=0.15)
    assert prior.exists()
