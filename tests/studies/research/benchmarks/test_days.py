"""Days with a truth of their own: what is drawn, and how it is counted."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

from studies.research.benchmarks.day import ARMS, SIGMA, Setting, draw_day
from studies.research.benchmarks.days import coverage, groups, main

SMALL = Setting("SCARA", scatter=0.0, approaches=1, poses=40, markers=3)


@pytest.mark.parametrize("index", [0, 1], ids=["joints", "tip"])
@pytest.mark.parametrize("arm", ARMS)
def test_tip_scatters_by_so_much(arm: str, index: int) -> None:
    """The tip from its markers: weights that add up to one and balance them at its origin."""
    day = draw_day(Setting(arm, 30e-6, 1, 40, 6), index, 0)
    assert bool(day.scatter.joints.any()) == (index == 0)
    sums = np.vstack([day.markers.T, np.ones(6)])
    weights = np.linalg.lstsq(sums, [0.0, 0.0, 0.0, 1.0], rcond=None)[0]
    moved = np.einsum("m,tmi->ti", weights, day.approached - day.reached)
    rms = np.sqrt(np.mean(np.sum(moved**2, axis=1)))
    assert rms == pytest.approx(30e-6, rel=0.15)


def test_instrument_and_approaches() -> None:
    """Each pose so often, others between; without scatter the noise of the instrument alone."""
    day = draw_day(Setting("6R", 0.0, 3, 40, 3), 0, 0)
    poses = [name[:4] for name in day.names]
    assert all(poses.count(pose) == 3 for pose in set(poses))
    assert all(a != b for a, b in pairwise(poses))
    assert np.std(day.read - day.exact) == pytest.approx(SIGMA, rel=0.06)
    np.testing.assert_array_equal(day.approached, day.reached)
    loose = draw_day(Setting("6R", 30e-6, 3, 40, 3), 0, 0)
    assert np.std(loose.read - loose.exact) > 1.4 * SIGMA
    again = draw_day(Setting("6R", 30e-6, 3, 40, 3), 0, 0)
    np.testing.assert_array_equal(loose.read, again.read)


def fake(held: list[bool], **more: Any) -> dict[str, Any]:
    """A day as it is written."""
    names = {f"p{i}": h for i, h in enumerate(held)}
    found = {"held": names, "off_in_std": dict.fromkeys(names, 2.0)}
    return {**SMALL.__dict__, "day": 0, "in_joints": True, **found, **more}


def test_summaries_by_hand() -> None:
    days = [fake([True, False]), fake([True, True])]
    found = coverage(days)
    assert (found["held"], found["intervals"], found["rms_off_in_std"]) == (3, 4, 2.0)
    assert found["worst"] == "SCARA, 3 markers: p1"
    assert (found["worst_held"], found["worst_intervals"]) == (1, 2)
    loose = fake([True], scatter=3e-5)
    assert {name: len(own) for name, own in groups([*days, loose]).items()} == {
        "all": 3,
        "0 mm": 2,
        "0.03 mm": 1,
    }


@pytest.mark.long
def test_command(tmp_path: Path) -> None:
    options = "--days 2 --arm SCARA --scatter 0 --scatter 0.03"
    options += f" --approaches 2 --poses 40 --markers 1 --json {tmp_path / 'days.json'}"
    done = CliRunner().invoke(main, options.split())
    assert done.exit_code == 0, done.output
    assert max(map(len, done.output.splitlines())) <= 120
    found = json.loads((tmp_path / "days.json").read_text())
    assert [(d["scatter"], d["in_joints"]) for d in found["days"]] == [
        (0.0, False), (0.0, False), (3e-5, True), (3e-5, False),
    ]  # fmt: skip
    assert set(found["summaries"]) >= {"all", "0 mm", "0.03 mm", "in the joints"}
