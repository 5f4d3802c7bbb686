"""Drawing, writing and scoring cases of real arms."""

from __future__ import annotations

import csv
import io
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from studies.research.sealed.draw import NONCENTRALITY, REAL_SHARES, WHOLE, Case
from studies.research.sealed.key import key_of, write_case
from studies.research.sealed.populations import POPULATIONS
from studies.research.sealed.visible import beside_others
from studies.research.truth.files import cell_of_scene, table_of_scene
from studies.research.truth.scene import RATIO

SEED = 20


@pytest.fixture(scope="module")
def drawn() -> dict[str, Case]:
    """One case of each family."""
    return {
        f: POPULATIONS["real_arms"].draw(np.random.default_rng([SEED, i]), f)
        for i, f in enumerate(REAL_SHARES)
    }


@pytest.fixture(scope="module")
def keys(drawn: dict[str, Case]) -> dict[str, dict[str, Any]]:
    return {f: key_of(case, f"case_{f}", 0, "salt") for f, case in drawn.items()}


def asked(key: dict[str, Any]) -> list[dict[str, Any]]:
    return [entry for entry in key["effects"] if not entry.get("background")]


@pytest.mark.long
def test_families_hold_what_they_say(keys: dict[str, dict[str, Any]]) -> None:
    assert asked(keys["null"]) == []
    assert len(asked(keys["single"])) == 1
    assert 3 <= len(asked(keys["mixture"])) <= 8
    assert len({entry["effect"] for entry in asked(keys["whole"])}) == 1
    assert asked(keys["whole"])[0]["effect"] in WHOLE
    assert keys["outside"]["outside"] is not None
    assert asked(keys["outside"]) == []
    low, high = NONCENTRALITY
    for key in keys.values():
        json.dumps(key, allow_nan=False)
        for entry in key["effects"]:
            assert entry["beside"] <= entry["noncentrality"] * 1.001
            bounds = (1.0, 20.0) if entry.get("background") else (low, high)
            if key["family"] != "whole" or entry.get("background"):
                assert 0.9 * bounds[0] < entry["noncentrality"] < 1.1 * bounds[1]


@pytest.mark.long
def test_files_hold_what_the_key_says(drawn: dict[str, Case], tmp_path: Path) -> None:
    """Read by the program; torques, gear ratios and the missing clock as the conditions say."""
    for family, case in drawn.items():
        scene = case.scene
        plain = replace(case, scene=replace(scene, ratios_said=False, measured=None))
        write_case(tmp_path / family, plain)
        cell = calib.load_cell(tmp_path / family / "cell.toml")
        held = calib.load_measurements(cell, tmp_path / family / "heldout.csv")
        assert len(held.poses) == scene.session.held.sum()
        torques = np.random.default_rng(0).normal(size=scene.session.q.shape).round(4)
        told = replace(case, scene=replace(scene, ratios_said=True, measured=torques))
        cell_said = tomllib.loads(cell_of_scene("case", told.scene))["robot"]["gear_ratio"]
        assert cell_said == scene.ratios
        assert all(RATIO[0] <= ratio <= RATIO[1] for ratio in cell_said.values())
        rows = list(
            csv.DictReader(
                io.StringIO(table_of_scene(told.scene, told.noisy, told.seen, np.array([3])))
            )
        )
        for k, joint in enumerate(scene.arm.joints):
            column = f"{joint.name}_{'N' if joint.slides else 'Nm'}"
            assert float(rows[0][column]) == pytest.approx(torques[3, k])
        assert ("time_s" in rows[0]) == (case.conditions.missing != "time")


def test_beside_others_by_hand() -> None:
    """Three displacements in the plane and out of it; one of them is a sum of what others can do."""
    x, y, z = np.eye(3)
    rests = [3.0 * x, 4.0 * (x + y), 5.0 * (y + z)]
    spans = [np.stack([x, z], axis=1), rests[1][:, None], rests[2][:, None]]
    # The second and third span a plane with normal (1, -1, 1); the first and third span all but none.
    found = beside_others(rests, spans)
    assert found == pytest.approx((9.0 / 3.0, 0.0, 0.0), abs=1e-12)
    assert beside_others([2.0 * x], [x[:, None]]) == (4.0,)
