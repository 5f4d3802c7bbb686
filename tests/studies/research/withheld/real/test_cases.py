"""Drawing, writing and scoring cases of real arms."""

from __future__ import annotations

import csv
import io
import json
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from studies.research.withheld.causes import RATIO, TAU, cause_at
from studies.research.withheld.draw import NONCENTRALITY, Case
from studies.research.withheld.judge import unit
from studies.research.withheld.keys import cell_text, key_of, table_text, tuning_of, write_case
from studies.research.withheld.make import POPULATIONS, families, make
from studies.research.withheld.real_arms import SHARES, WHOLE, draw_conditions
from studies.research.withheld.robots import HEAVY
from studies.research.withheld.seal import read_json
from tests.studies.research.withheld.real.scenes import day_of

SEED = 20


@pytest.fixture(scope="module")
def drawn() -> dict[str, Case]:
    """One case of each family."""
    return {
        f: POPULATIONS["real_arms"].draw(np.random.default_rng([SEED, i]), f)
        for i, f in enumerate(SHARES)
    }


@pytest.fixture(scope="module")
def keys(drawn: dict[str, Case]) -> dict[str, dict[str, Any]]:
    return {f: key_of(case, f"case_{f}", 0, "salt") for f, case in drawn.items()}


def asked(key: dict[str, Any]) -> list[dict[str, Any]]:
    return [entry for entry in key["effects"] if not entry.get("background")]


@pytest.mark.long
def test_same_seed_same_cases(tmp_path: Path) -> None:
    for name in ("one", "two"):
        make(tmp_path / name, 1, 8, population="real_arms")
    files = sorted(path for path in (tmp_path / "one" / "cases").rglob("*.*"))
    assert len(files) == 4
    for path in files:
        again = tmp_path / "two" / path.relative_to(tmp_path / "one")
        assert path.read_bytes() == again.read_bytes()
    one, two = (read_json(tmp_path / n / "keys" / "case_0000.json") for n in ("one", "two"))
    assert one.pop("salt") != two.pop("salt")
    assert one == two


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


def test_shares_and_conditions() -> None:
    counted = Counter(families(np.random.default_rng(0), 600, SHARES))
    assert counted == {"null": 120, "single": 204, "mixture": 120, "whole": 72, "outside": 84}
    rng = np.random.default_rng(0)
    drawn = [draw_conditions(rng) for _ in range(2000)]
    assert np.mean([c.background for c in drawn]) == pytest.approx(0.5, abs=0.05)
    assert np.mean([c.one_marker for c in drawn]) == pytest.approx(0.12, abs=0.03)
    assert np.mean([c.missing == "time" for c in drawn]) == pytest.approx(0.2, abs=0.03)
    readings = {"once": 1, "free and loaded": 2, "thrice": 3}
    for c in drawn:
        assert c.configurations >= 40
        assert c.configurations * readings[c.visit] <= 150
        assert not (c.one_marker and c.visit == "once" and c.configurations > 80)


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
        cell_said = tomllib.loads(cell_text("case", told.scene))["robot"]["gear_ratio"]
        assert cell_said == scene.ratios
        assert all(RATIO[0] <= ratio <= RATIO[1] for ratio in cell_said.values())
        rows = list(csv.DictReader(io.StringIO(table_text(told, np.array([3])))))
        for k, joint in enumerate(scene.arm.joints):
            column = f"{joint.name}_{'N' if joint.slides else 'Nm'}"
            assert float(rows[0][column]) == pytest.approx(torques[3, k])
        assert ("time_s" in rows[0]) == (case.conditions.missing != "time")


@pytest.mark.parametrize("missing", [None, "time"])
def test_what_is_tuned_says_how_near_is_near(missing: str | None) -> None:
    """Two widths of a line, three readings; time constants within the session, in the file's clock."""
    scene, rng = day_of(HEAVY, missing=missing), np.random.default_rng(0)
    fitted = ~scene.session.held
    time = scene.session.time[fitted]
    clock = np.arange(fitted.sum()) if missing else time - scene.session.time[0]
    for _ in range(5):
        ripple = cause_at(rng, scene, "gear_ripple", "A3")
        q = scene.session.q[fitted, 2]
        near = tuning_of(scene, ripple)["tuned"]
        assert near["tolerance"] == pytest.approx(4.0 * np.pi / (q.max() - q.min()))
        assert near["value"] == 2 * scene.ratios["A3"]
        jump = tuning_of(scene, cause_at(rng, scene, "step", "base"))
        low, high = jump["between"]["at"]
        assert low < jump["tuned"]["value"] < high
        assert np.isclose(clock, low).any()
        assert np.isclose(clock, high).any()
        assert jump["tuned"]["unit"] == ("readings" if missing else "s")
        assert jump["tuned"]["tolerance"] == pytest.approx(3.0 * clock[-1] / (len(clock) - 1))
        tau = cause_at(rng, scene, "warm_up", "instrument").values["tau"]
        assert TAU[0] * clock[-1] <= tau <= TAU[1] * clock[-1]
    assert unit("warm_up", "tau", timed=missing is None) == ("readings" if missing else "min")
