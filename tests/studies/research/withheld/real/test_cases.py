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
from click.testing import CliRunner
from rich.console import Console

pytest.importorskip("mujoco")

import calib
from studies.research.withheld.__main__ import main
from studies.research.withheld.causes import RATIO, TAU, cause_at
from studies.research.withheld.draw import NONCENTRALITY, Case
from studies.research.withheld.judge import unit
from studies.research.withheld.keys import cell_text, key_of, table_text, tuning_of, write_case
from studies.research.withheld.make import POPULATIONS, families, make
from studies.research.withheld.real_arms import SCATTER, SHARES, WHOLE, draw_conditions
from studies.research.withheld.robots import HEAVY, MODELS, draw_arm
from studies.research.withheld.score import score, show
from studies.research.withheld.seal import commit_answers, commit_keys, read_json, write_json
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


def test_no_arm_is_met_twice() -> None:
    rng = np.random.default_rng(0)
    arms = [draw_arm(rng) for _ in range(60)]
    assert len({arm.joints[1].xyz + arm.tip_xyz for arm in arms}) == 60
    assert {arm.name for arm in arms} == {model.name for model in MODELS}
    for arm in arms:
        assert np.all(np.diff(arm.limits, axis=1) > 0.0)


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


@pytest.mark.long
def test_arms_scatter_in_their_joints(drawn: dict[str, Case]) -> None:
    for case in drawn.values():
        scatter, scene = case.scene.scatter, case.scene
        assert scatter is not None
        assert not scatter.tip.any()
        still = np.sqrt(np.mean(scatter.squares(scene.arm, case.state)))
        ratio = still / scene.noise.rms(case.clean, np.ones(case.seen.shape, dtype=bool))
        assert 0.9 * SCATTER[0] < ratio < 1.1 * SCATTER[1]


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


def knowing(key: dict[str, Any]) -> dict[str, Any]:
    """The answer of one who knows the key."""
    outside = [key["outside"]] if key["outside"] else []
    effects = [
        {
            "effect": entry["effect"],
            "where": entry["where"],
            "probability": 0.95,
            "parameters": [{**p, "std": abs(p["value"]) + 1.0} for p in entry["parameters"]],
        }
        for entry in key["effects"]
    ]
    verdict = "unknown" if outside else "explained" if effects else "no_gap"
    places = [
        {"where": c["where"] if c["where"] in c["places"] else c["places"][0],
         "depends_on": (c["depends_on"] or ["none"])[0]}
        for c in [*outside, *asked(key)]
    ]  # fmt: skip
    floor = key["heldout_noise_rms_mm"]
    return {
        "verdict": verdict,
        "effects": effects,
        "located": places,
        "gap": {"heldout_before_mm": 2.0 * floor, "heldout_after_mm": floor},
    }


@pytest.fixture
def scored(keys: dict[str, dict[str, Any]], tmp_path: Path) -> dict[str, Any]:
    """The score of who knows the keys, beside one who says the opposite."""
    folder = tmp_path / "cases"
    (folder / "cases").mkdir(parents=True)
    (folder / "keys").mkdir()
    runs = {key["case"]: {"status": "answered", "seconds": 1.0} for key in keys.values()}
    for key in keys.values():
        write_json(folder / "keys" / f"{key['case']}.json", key)
    commit_keys(folder)
    for name in ("diagnosis", "fool"):
        (folder / "answers" / name).mkdir(parents=True)
        for key in keys.values():
            answer = knowing(key)
            if name == "fool":
                wrong = {"effect": "transmission_scale", "where": "nowhere", "probability": 0.95}
                answer |= {"effects": [wrong], "verdict": "explained", "located": []}
                answer["gap"]["heldout_after_mm"] = 3.0 * key["heldout_noise_rms_mm"]
            write_json(folder / "answers" / name / f"{key['case']}.json", answer)
        commit_answers(folder, json.loads(json.dumps(runs)), ["by hand"], name)
    return score(folder)


@pytest.mark.long
def test_who_knows_the_keys_scores_fully(scored: dict[str, Any]) -> None:
    rows = {(row["family"], row["figure"]): row for row in scored["rates"]}
    fool = {(row["family"], row["figure"]): row for row in scored["rivals"]["fool"]["rates"]}
    barred = [at for at, row in rows.items() if row["bar"] and row["n"] and at[0] != "names"]
    assert len(barred) >= 8
    for at in barred:
        best = rows[at]["bar"][0] > 0.0  # a share to be reached, or one to be kept below
        assert rows[at]["rate"] == best, at
        assert fool[at]["rate"] == 1.0 - best, at
    assert rows["names", "given 0.90 or more, right"]["rate"] == 1.0
    assert fool["names", "given 0.925 to 0.975, right"]["rate"] == 0.0
    assert scored["coverage"]["rate"] == 1.0
    assert scored["heldout_over_floor"]["bars"] == [1.06, 1.2]
    assert 0.8 < scored["heldout_over_floor"]["median"] < 1.2


@pytest.mark.long
def test_score_in_print(scored: dict[str, Any]) -> None:
    json.dumps(scored, allow_nan=False)
    console = Console(width=120, record=True, file=io.StringIO())
    show(console, scored)
    printed = console.export_text()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 120
    for said in ("mixture, each visible cause", "above before"):
        assert said in printed


def test_option_goes_alone(tmp_path: Path) -> None:
    options = ["make", "1", "--seed", "1", str(tmp_path / "cases"), "--arm-noise", "--real-arms"]
    done = CliRunner().invoke(main, options)
    assert done.exit_code == 2
    assert "leave the others out" in done.output
