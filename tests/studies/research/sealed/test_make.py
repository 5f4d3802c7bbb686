"""Cases of every population: drawn as ever, written, sealed, answered and scored."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import shutil
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

pytest.importorskip("mujoco")

import calib
from calib.effects import EFFECTS
from studies.research.sealed.__main__ import main
from studies.research.sealed.draw import (
    FIRST_SHARES,
    FOREIGN_SHARES,
    NONCENTRALITY,
    REAL_SHARES,
    WHOLE,
    Case,
    draw_case,
    draw_foreign_case,
)
from studies.research.sealed.instruments import READERS, Fault, Sensed, draw_sensed
from studies.research.sealed.judge import is_listed, judge
from studies.research.sealed.key import key_of, key_of_sensed, write_case, write_sensed
from studies.research.sealed.score import score, shown
from studies.research.sealed.seal import (
    POPULATIONS,
    BrokenSeal,
    commit_answers,
    make,
    opened,
    read_json,
    run,
    write_json,
)
from studies.research.sealed.visible import Projector, beside_others
from studies.research.truth import foreign
from studies.research.truth.arms import ARMS
from studies.research.truth.causes import Cause
from studies.research.truth.files import cell_of_scene, table_of_scene
from studies.research.truth.scene import RATIO, at_rest
from tests.studies.research.sealed.scenes import scene_of

COUNT = 8
# Says that there is no gap, except where it fails.
PROGRAM = """
import json, sys
cell, data, heldout, answer = sys.argv[1:]
if "case_0001" in cell:
    sys.exit(2)
gap = {"heldout_before_mm": 0.03, "heldout_after_mm": 0.03}
with open(answer, "w") as file:
    json.dump({"verdict": "no_gap", "effects": [], "located": [], "gap": gap}, file)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sealed") / "cases"
    make(path, COUNT, 11)
    return path


@pytest.fixture(scope="module")
def once(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cases with answers."""
    copy = tmp_path_factory.mktemp("answered") / "cases"
    shutil.copytree(folder, copy)
    program = copy.parent / "program.py"
    program.write_text(PROGRAM)
    tables = ("{cell}", "{data}", "{heldout}", "{answer}")
    run(copy, command=(sys.executable, str(program), *tables))
    return copy


@pytest.fixture
def answered(once: Path, tmp_path: Path) -> Path:
    """A copy of them to spoil."""
    return Path(shutil.copytree(once, tmp_path / "copy"))


def test_files_are_read_by_the_program(folder: Path) -> None:
    """Every file is a valid input, and names no cause."""
    for case in sorted((folder / "cases").iterdir()):
        cell = calib.load_cell(case / "cell.toml")
        key = read_json(folder / "keys" / f"{case.name}.json")
        fitted = calib.load_measurements(cell, case / "measurements.csv")
        held = calib.load_measurements(cell, case / "heldout.csv")
        assert len(held.poses) == 40
        assert len(fitted.poses) == (106 if key["conditions"]["configurations"] == 45 else 38)
        text = (case / "cell.toml").read_text()
        assert not any(f"{e['effect']}:{e['where']}" in text for e in key["effects"])


@pytest.mark.long
@pytest.mark.parametrize("family", FIRST_SHARES)
def test_sizes_by_noncentrality(family: str) -> None:
    case = draw_case(np.random.default_rng(4), family)
    low, high = NONCENTRALITY
    assert len(case.causes) == {"null": 0, "pair": 2}.get(family, 1)
    assert all(0.9 * low < value < 1.1 * high for value in case.noncentrality)
    assert all(b <= a * 1.001 for a, b in zip(case.noncentrality, case.beside, strict=True))
    key = key_of(case)
    assert bool(key["outside"]) == (family == "outside")
    assert all(("shape" in effect) == (family == "shape") for effect in key["effects"])
    json.dumps(key, allow_nan=False)


def test_what_is_modelled_is_invisible() -> None:
    """A compliance that the model has, a turned base and a moved marker leave nothing."""
    scene = scene_of(ARMS[1])
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    seen = np.ones(still.points.shape[:2], dtype=bool)
    projector = Projector(scene, still, seen)
    modelled = scene.modelled[0]
    for effect, where, name, size in (
        ("joint_compliance", modelled, "compliance", 1e-8),
        ("link_geometry", scene.arm.names[0], "rz", 1e-6),
        ("backlash", modelled, "half_width", 1e-5),
    ):
        moved = (
            at_rest(scene, mechanism, [Cause(effect, where, {name: size})]).readings
            - still.readings
        )
        share = np.linalg.norm(projector.left(moved)) * scene.noise.sigma / np.linalg.norm(moved)
        assert (share > 0.1) == (effect == "backlash"), effect


def perfect(key: dict[str, Any]) -> dict[str, Any]:
    """The answer of one who knows the key."""
    causes = key["effects"] or ([key["outside"]] if key["outside"] else [])
    effects = [
        {
            "effect": cause["effect"],
            "where": cause["where"],
            "probability": 1.0,
            "class": [{"effect": cause["effect"], "where": cause["where"]}],
            "parameters": [{**p, "std": abs(p["value"]) + 1.0} for p in cause["parameters"]],
        }
        for cause in key["effects"]
    ]
    verdicts = {"null": "no_gap", "outside": "unknown", "shape": "unknown"}
    return {
        "verdict": verdicts.get(key["family"], "explained"),
        "effects": effects,
        "located": [{"where": c["where"], "depends_on": "none"} for c in causes],
        "gap": {"heldout_after_mm": key["heldout_noise_rms_mm"]},
    }


def test_who_knows_the_keys_scores_fully(answered: Path) -> None:
    runs = {}
    for path in (answered / "keys").glob("case_*.json"):
        write_json(answered / "answers" / "diagnosis" / path.name, perfect(read_json(path)))
        runs[path.stem] = {"status": "answered", "seconds": 1.0}
    commit_answers(answered, runs, ["by hand"])
    result = score(answered)
    assert result["failed"] == 0
    for row in result["rates"]:
        if row["bar"] is not None and row["n"]:
            assert row["rate"] == row["bar"][row["bar"][0] > 0.0], row
    assert result["coverage"]["rate"] == 1.0
    assert all(row["hits"] == row["n"] for row in result["reliability"])
    assert 0.8 < result["heldout_over_floor"]["median"] < 1.2


def test_what_is_printed(answered: Path) -> None:
    """A program that sees no gap: every figure in a line that is not cut."""
    result = score(answered)
    assert result["failed"] == 1
    json.dumps(result, allow_nan=False)
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(*shown(result), sep="\n")
    printed = console.export_text()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 120
    alarms = next(x for x in printed.splitlines() if "false alarms" in x)
    assert alarms.split()[-1] == ("yes" if result["rates"][0]["met"] else "no")
    assert "at most 4" in alarms
    assert sum("located" in x for x in printed.splitlines()) == 2


def test_an_answer_that_is_gone_is_seen(answered: Path) -> None:
    (answered / "answers" / "diagnosis" / "case_0003.json").unlink()
    with pytest.raises(BrokenSeal, match="case_0003"):
        opened(answered)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["run", "nowhere"], "no sealed cases"),
        (["make", "nowhere", "--seed", "1", "--foreign", "--real-arms"], "leave the others out"),
        (["score", "nowhere"], "no sealed cases"),
    ],
)
def test_faults_in_one_line(options: list[str], said: str, tmp_path: Path) -> None:
    options[1] = str(tmp_path / options[1])
    options[1:1] = ["2"] if options[0] == "make" else []
    done = CliRunner().invoke(main, options)
    assert done.exit_code in (1, 2)
    assert said in done.output
    assert "Traceback" not in done.output


def test_no_score_before_answers(folder: Path) -> None:
    with pytest.raises(BrokenSeal, match="not committed"):
        opened(folder)


@pytest.mark.parametrize(
    "name",
    [
        "keys/case_0000.json",
        "answers/diagnosis/case_0000.json",
        "cases/case_0000/heldout.csv",
        "commitment.json",
    ],
)
def test_tampering_is_seen(answered: Path, name: str) -> None:
    path = answered / name
    path.write_text(path.read_text().replace("0", "1", 1))
    with pytest.raises(BrokenSeal, match=path.name):
        opened(answered)


def test_the_first_cases_count_and_chosen_ones_do_not(answered: Path) -> None:
    runs = {f"case_{i:04d}": {"status": "answered", "seconds": 1.0} for i in (0, 2)}
    commit_answers(answered, {"case_0000": runs["case_0000"]}, ["by hand"])
    assert score(answered)["cases"] == 1
    commit_answers(answered, runs, ["by hand"])
    with pytest.raises(BrokenSeal, match="chosen cases"):
        opened(answered)


@pytest.mark.long
def test_slow_program_counts_as_no_answer(folder: Path, tmp_path: Path) -> None:
    make(tmp_path / "one", 1, 5)
    command = (sys.executable, "-c", "import time; time.sleep(20)")
    runs = run(tmp_path / "one", command=command, limit=0.2)
    assert runs["case_0000"]["status"] == "too slow"
    assert opened(tmp_path / "one")[2] == {"case_0000": None}


# -- Seeds of published figures give the same files, to the last digit, whatever the generator becomes


# sha256 over cell, table of the hold-out, table and URDF.
DIGESTS = {
    ("first", "null", 3): "136056e61882f022",
    ("first", "null", 6): "76b6d383ec80ffdf",
    ("first", "outside", 8): "28066001d5292f55",
    ("arm_noise", "null", 0): "ff0ec7fa29f36c2f",
    ("arm_noise", "pair", 1): "d0299ddde6f480f3",
    ("real_arms", "single", 0): "c391ae4dbce62173",
    ("real_arms", "mixture", 1): "a4464144a59edf58",
    ("real_arms", "whole", 2): "ee4ca009b811bed2",
    ("instruments", "single", 0): "6b2323fb258a6f11",
    ("instruments", "instrument", 1): "3ed12fda7e72eee3",
}


@pytest.mark.sampled
@pytest.mark.parametrize(("population", "family", "index"), DIGESTS)
def test_cases_stay(population: str, family: str, index: int, tmp_path: Path) -> None:
    own = POPULATIONS[population]
    case = own.draw(np.random.default_rng([77, index]), family)
    folder = tmp_path / f"case_{index:04d}"
    own.write(folder, case)
    whole = b"".join(path.read_bytes() for path in sorted(folder.iterdir()))
    known = DIGESTS[population, family, index]
    assert hashlib.sha256(whole).hexdigest().startswith(known)
    key = own.key(case)
    assert ("arm_noise" in key["conditions"]) == (population in ("arm_noise", "real_arms"))


# -- Causes by other formulas: the formulas, and cases that are told by the catalogue's names


def test_formulas() -> None:
    moves = np.array([0.5, -0.01, -0.6, 0.02, 0.0, 0.4])
    assert foreign.play_with_dead_band(moves, 0.05).tolist() == [1, 1, -1, -1, -1, 1]
    q = np.linspace(-np.pi, np.pi, 2001)[:-1]
    wheel = foreign.eccentric(q, 0.3, 0.5, 0.9)
    assert 2 * np.mean(wheel * np.sin(q - 0.3)) == pytest.approx(1.0, rel=0.005)
    assert 2 * np.mean(wheel * np.sin(2 * q - 0.9)) == pytest.approx(0.5, rel=0.1)
    third = np.hypot(*(2 * np.mean(wheel * f(3 * q)) for f in (np.cos, np.sin)))
    assert 1e-3 < third < 5e-3  # what no harmonic of the catalogue has
    torque = np.linspace(-50.0, 50.0, 11)
    np.testing.assert_allclose(foreign.hardening(torque, 0.3)[[0, 5, -1]], [-35.0, 0.0, 35.0])
    time = np.arange(0.0, 40000.0, 10.0)
    lag = foreign.lagging(20.0 + 1e-3 * time, time, 1200.0)
    np.testing.assert_allclose(20.0 + 1e-3 * time[-1] - lag[-1], 1.2, rtol=0.01)


@pytest.mark.parametrize("family", FOREIGN_SHARES)
def test_a_case_is_told_by_names_of_the_catalogue(family: str) -> None:
    key = {"case": "case", **key_of(draw_foreign_case(np.random.default_rng(3), family))}
    json.dumps(key, allow_nan=False)
    low, high = NONCENTRALITY
    entries = key["effects"]
    assert (len(entries) == 1) == (family == "single")
    assert len({e["effect"] for e in entries}) == (2 if family == "mixture" else 1)
    if family == "single":
        assert 0.9 * low < entries[0]["noncentrality"] < 1.1 * high
    assert not any(p["scored"] for e in entries for p in e["parameters"])
    said = [
        {"effect": e["effect"], "where": e["where"], "parameters": e["parameters"]} for e in entries
    ]
    judged = judge(key, {"verdict": "explained", "effects": said, "located": []})
    assert judged.exact
    assert not judged.intervals
    for entry in entries:
        for name in entry.get("alike", ()):
            effect, where = name.split(":")
            other = {"effect": effect, "where": where, "parameters": entry["parameters"]}
            assert is_listed(other, entry)


# -- Sealed cases that other instruments read: noise as sealed, faults as drawn, through files alone


# It takes seconds to put a ball into sockets, and cameras have their noise by their faults below.
QUICK = ("pose", "distance")
SOCKET = pytest.param("socket", marks=pytest.mark.long)


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=() if k in QUICK else pytest.mark.long) for k in READERS]
)
def test_the_truth_is_known_to_its_noise(kind: str, tmp_path: Path) -> None:
    """Without a cause the user's model fits within the noise, whose size the key holds."""
    case = draw_sensed(np.random.default_rng(4), "null", kind)
    write_sensed(tmp_path / "case", case)
    cell = calib.load_cell(tmp_path / "case" / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    found = calib.identify(cell, data)
    assert found.status == "converged"
    assert found.noise.factor == pytest.approx(1.0, abs=0.15)
    heldout = calib.load_measurements(cell, tmp_path / "case" / "heldout.csv")
    off = found.model.off(found.values, heldout) * found.model.readout.channels.lengths
    rms = np.sqrt((off**2).sum(axis=-1)[heldout.seen].mean())
    scale = 1.0 if "camera" in kind else 1e3
    assert rms * scale == pytest.approx(case.reader.floor, rel=0.25)


def known(case: Sensed) -> bool:
    """Whether the fault is an effect of the catalogue: some of those that are drawn are none."""
    return key_of_sensed(case)["effects"][0]["effect"] in EFFECTS


@pytest.mark.parametrize("kind", ["world camera", "tip camera", SOCKET])
def test_faults_are_what_the_answers_call_them(kind: str, tmp_path: Path) -> None:
    """The effect of the key in the model takes up what the fault does, at its value."""
    drawn = (draw_sensed(np.random.default_rng(k), "instrument", kind) for k in range(5, 50))
    case = next(own for own in drawn if isinstance(own.cause, Fault) and known(own))
    write_sensed(tmp_path / "case", case)
    (entry,) = key_of_sensed(case)["effects"]
    path = tmp_path / "case" / "cell.toml"
    effect = f'"{entry["effect"]}:{entry["where"]}"'
    path.write_text(path.read_text().replace('"tool"]', f'"tool", {effect}]'))
    cell = calib.load_cell(path)
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    found = calib.identify(cell, data)
    assert found.noise.factor == pytest.approx(1.0, abs=0.15)
    for truth in entry["parameters"]:
        ids = [(p.effect, p.name) for p in found.model.parameters]
        at = ids.index((entry["effect"], truth["name"]))
        p = found.model.parameters[at]
        assert p.unit == truth["unit"]
        assert abs(found.values[at] / p.scale - truth["value"]) < 4.0 * found.std[at] / p.scale


# -- Drawing, writing and scoring cases of real arms


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
    return {f: key_of(case) for f, case in drawn.items()}


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
        said, unsaid = (replace(scene.conditions, ratios_said=yes) for yes in (True, False))
        plain = replace(case, scene=replace(scene, conditions=unsaid, measured=None))
        write_case(tmp_path / family, plain)
        cell = calib.load_cell(tmp_path / family / "cell.toml")
        held = calib.load_measurements(cell, tmp_path / family / "heldout.csv")
        assert len(held.poses) == scene.session.held.sum()
        torques = np.random.default_rng(0).normal(size=scene.session.q.shape).round(4)
        told = replace(case, scene=replace(scene, conditions=said, measured=torques))
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
        assert ("time_s" in rows[0]) == (scene.conditions.missing != "time")


def test_beside_others_by_hand() -> None:
    """Three displacements in the plane and out of it; one of them is a sum of what others can do."""
    x, y, z = np.eye(3)
    rests = [3.0 * x, 4.0 * (x + y), 5.0 * (y + z)]
    spans = [np.stack([x, z], axis=1), rests[1][:, None], rests[2][:, None]]
    # The second and third span a plane with normal (1, -1, 1); the first and third span all but none.
    found = beside_others(rests, spans)
    assert found == pytest.approx((9.0 / 3.0, 0.0, 0.0), abs=1e-12)
    assert beside_others([2.0 * x], [x[:, None]]) == (4.0,)
