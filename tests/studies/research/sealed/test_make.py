"""Cases of every population: drawn as ever, written, sealed, answered and scored."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

pytest.importorskip("mujoco")

import calib
from studies.research.sealed.__main__ import main
from studies.research.sealed.draw import NONCENTRALITY, WHOLE, Case
from studies.research.sealed.judge import is_listed, judge
from studies.research.sealed.key import key_of, write_case
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
from studies.research.truth.scene import at_rest
from tests.studies.research.sealed.scenes import read_files, scene_of

# -- Cases of every family: the same files as ever, and a key that says what is in them

# sha256 over cell, table of the hold-out, table and URDF: seeds of published figures give the same
# files, whatever becomes of what draws them.
DIGESTS = {
    ("foreign", "single", 0): "acc6a7d9c38309e9",
    ("foreign", "whole", 1): "45a093dd84393a88",
    ("foreign", "mixture", 2): "627285678e8487d1",
    ("first", "null", 3): "136056e61882f022",
    ("first", "single", 1): "4c8ebb23d850bf06",
    ("first", "pair", 2): "b55fc59660126d9c",
    ("first", "shape", 4): "be66ffb990315979",
    ("first", "outside", 8): "28066001d5292f55",
    ("arm_noise", "null", 0): "ff0ec7fa29f36c2f",
    ("arm_noise", "pair", 1): "d0299ddde6f480f3",
    ("real_arms", "null", 3): "713394370b5560cd",
    ("real_arms", "single", 0): "c391ae4dbce62173",
    ("real_arms", "mixture", 1): "a4464144a59edf58",
    ("real_arms", "whole", 2): "ee4ca009b811bed2",
    ("real_arms", "outside", 4): "ed6f47ec777d5353",
}
# How many causes a key asks for, where it is not one.
ASKED = {"null": (0, 0), "outside": (0, 0), "pair": (2, 2), "mixture": (3, 8), "whole": (3, 7)}


@pytest.mark.sampled
@pytest.mark.parametrize(("population", "family", "index"), DIGESTS)
def test_a_case_is_what_its_key_says(
    population: str, family: str, index: int, tmp_path: Path
) -> None:
    """Drawn, written and read by the program; who knows its key is right in everything."""
    own, folder = POPULATIONS[population], tmp_path / f"case_{index:04d}"
    case = own.draw(np.random.default_rng([77, index]), family)
    write_case(folder, case)
    whole = b"".join(path.read_bytes() for path in sorted(folder.iterdir()))
    assert hashlib.sha256(whole).hexdigest().startswith(DIGESTS[population, family, index])
    key = {"case": folder.name, **key_of(case)}
    json.dumps(key, allow_nan=False)
    read_as_said(folder, case, key)
    causes = asked(key)
    fewest, most = ASKED.get(family, (1, 1))
    assert fewest <= len(causes) <= most
    assert bool(key["outside"]) == (family == "outside")
    assert all(("shape" in cause) == (family == "shape") for cause in causes)
    if family == "whole":
        assert len({cause["effect"] for cause in causes}) == 1
    if (population, family) == ("real_arms", "whole"):
        assert causes[0]["effect"] in WHOLE
    together = family == "whole" or (population, family) == ("foreign", "mixture")
    low, high = NONCENTRALITY
    for entry in [*key["effects"], *([key["outside"]] if key["outside"] else [])]:
        assert entry["beside"] <= entry["noncentrality"] * 1.001
        if entry.get("background"):
            assert 0.9 < entry["noncentrality"] < 22.0
        elif not together:
            assert 0.9 * low < entry["noncentrality"] < 1.1 * high
    judged = judge(key, perfect(key))
    assert judged.exact == judged.found == bool(causes)
    assert judged.located == (family != "null")
    assert not judged.alarm
    assert not judged.sure_wrong
    assert all(judged.intervals)
    assert bool(judged.intervals) == any(p["scored"] for c in causes for p in c["parameters"])
    for entry in causes:
        for name in entry.get("alike", ()):
            effect, where = name.split(":")
            assert is_listed({**entry, "effect": effect, "where": where}, entry)


def asked(key: dict[str, Any]) -> list[dict[str, Any]]:
    return [entry for entry in key["effects"] if not entry.get("background")]


def read_as_said(folder: Path, case: Case, key: dict[str, Any]) -> None:
    """Files that the program reads, with the columns of the conditions; they name no cause."""
    conditions, scene = key["conditions"], case.scene
    cell, data = read_files(folder)
    held = calib.load_measurements(cell, folder / "heldout.csv")
    text = (folder / "cell.toml").read_text()
    assert not any(f"{e['effect']}:{e['where']}" in text for e in key["effects"])
    said = tomllib.loads(text)["robot"].get("gear_ratio", {})
    assert said == (scene.ratios if conditions["ratios_said"] else {})
    rows = list(csv.DictReader(io.StringIO((folder / "measurements.csv").read_text())))
    for name, column in (("time", "time_s"), ("temperature", "temperature_degC")):
        assert (column in rows[0]) == (conditions["missing"] != name)
    fitted = np.flatnonzero(~scene.session.held)
    assert (len(data.poses), len(held.poses)) == (len(fitted), scene.session.held.sum())
    for k, joint in enumerate(scene.arm.joints):
        column = f"{joint.name}_{'N' if joint.slides else 'Nm'}"
        assert (column in rows[0]) == conditions["torques"]
        if scene.measured is not None:
            assert float(rows[0][column]) == pytest.approx(scene.measured[fitted[0], k])


def perfect(key: dict[str, Any]) -> dict[str, Any]:
    """The answer of one who knows the key."""
    causes = [*([key["outside"]] if key["outside"] else []), *key["effects"]]
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
        "located": [{"where": c["places"][0], "depends_on": "none"} for c in causes],
        "gap": {"heldout_after_mm": key.get("heldout_noise_rms_mm", key["floor_mm"])},
    }


# -- Sealed, answered and scored

COUNT = 5
# Says that there is no gap, except where it fails or takes its time.
PROGRAM = """
import json, sys, time
cell, data, heldout, answer = sys.argv[1:]
if "case_0001" in cell:
    sys.exit(2)
if "case_0002" in cell:
    time.sleep(60)
gap = {"heldout_before_mm": 0.03, "heldout_after_mm": 0.03}
with open(answer, "w") as file:
    json.dump({"verdict": "no_gap", "effects": [], "located": [], "gap": gap}, file)
"""
ANSWERED = {"status": "answered", "seconds": 1.0}


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
    run(copy, command=(sys.executable, str(program), *tables), limit=3.0)
    return copy


@pytest.fixture
def answered(once: Path, tmp_path: Path) -> Path:
    """A copy of them to spoil."""
    return Path(shutil.copytree(once, tmp_path / "copy"))


def test_who_knows_the_keys_scores_fully(answered: Path) -> None:
    runs = {}
    for path in (answered / "keys").glob("case_*.json"):
        write_json(answered / "answers" / "diagnosis" / path.name, perfect(read_json(path)))
        runs[path.stem] = dict(ANSWERED)
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
    """A program that sees no gap, fails and is too slow: every figure in a line that is not cut."""
    assert [run["status"] for run in opened(answered)[1].values()][:3] == [
        "answered", "failed", "too slow",
    ]  # fmt: skip
    result = score(answered)
    assert result["failed"] == 2
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


@pytest.mark.parametrize(
    ("name", "gone"),
    [
        ("answers/diagnosis/case_0003.json", True),
        ("keys/case_0000.json", False),
        ("answers/diagnosis/case_0000.json", False),
        ("cases/case_0000/heldout.csv", False),
        ("commitment.json", False),
    ],
)
def test_tampering_is_seen(answered: Path, name: str, gone: bool) -> None:
    path = answered / name
    text = path.read_text().replace("0", "1", 1)
    path.unlink() if gone else path.write_text(text)
    with pytest.raises(BrokenSeal, match=path.name):
        opened(answered)


def test_no_score_before_answers(folder: Path) -> None:
    with pytest.raises(BrokenSeal, match="not committed"):
        opened(folder)


def test_the_first_cases_count_and_chosen_ones_do_not(answered: Path) -> None:
    first, fourth = ({name: dict(ANSWERED)} for name in ("case_0000", "case_0003"))
    commit_answers(answered, first, ["by hand"])
    assert score(answered)["cases"] == 1
    commit_answers(answered, first | fourth, ["by hand"])
    with pytest.raises(BrokenSeal, match="chosen cases"):
        opened(answered)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["run", "nowhere"], "no sealed cases"),
        (
            ["make", "2", "nowhere", "--seed", "1", "--foreign", "--real-arms"],
            "leave the others out",
        ),
        (["score", "nowhere"], "no sealed cases"),
    ],
)
def test_faults_in_one_line(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, options)
    assert done.exit_code in (1, 2)
    assert said in done.output
    assert "Traceback" not in done.output


# -- By hand: what is visible beside a model and beside others, and formulas of no catalogue


def test_what_is_modelled_is_invisible() -> None:
    """A compliance that the model has, a turned base and a moved marker leave nothing."""
    scene = scene_of(ARMS[1])
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    projector = Projector(scene, still, np.ones(still.points.shape[:2], dtype=bool))
    modelled = scene.modelled[0]
    for effect, where, name, size in (
        ("joint_compliance", modelled, "compliance", 1e-8),
        ("link_geometry", scene.arm.names[0], "rz", 1e-6),
        ("backlash", modelled, "half_width", 1e-5),
    ):
        state = at_rest(scene, mechanism, [Cause(effect, where, {name: size})])
        moved = state.readings - still.readings
        share = np.linalg.norm(projector.left(moved)) * scene.noise.sigma / np.linalg.norm(moved)
        assert (share > 0.1) == (effect == "backlash"), effect


def test_beside_others_by_hand() -> None:
    """Three displacements in the plane and out of it; one of them is a sum of what others can do."""
    x, y, z = np.eye(3)
    rests = [3.0 * x, 4.0 * (x + y), 5.0 * (y + z)]
    spans = [np.stack([x, z], axis=1), rests[1][:, None], rests[2][:, None]]
    # The second and third span a plane with normal (1, -1, 1); the first and third span all but none.
    found = beside_others(rests, spans)
    assert found == pytest.approx((9.0 / 3.0, 0.0, 0.0), abs=1e-12)
    assert beside_others([2.0 * x], [x[:, None]]) == (4.0,)


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
