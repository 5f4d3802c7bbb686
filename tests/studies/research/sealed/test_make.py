"""Drawing, writing and sealing cases."""

from __future__ import annotations

import io
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

pytest.importorskip("mujoco")

import calib
from studies.research.sealed.__main__ import main
from studies.research.sealed.draw import FIRST_SHARES, NONCENTRALITY, draw_case
from studies.research.sealed.key import key_of
from studies.research.sealed.score import score, show
from studies.research.sealed.seal import (
    BrokenSeal,
    commit_answers,
    make,
    opened,
    read_json,
    run,
    write_json,
)
from studies.research.sealed.visible import Projector
from studies.research.truth.arms import ARMS
from studies.research.truth.causes import Cause
from studies.research.truth.scene import at_rest
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
    run(copy, command=f"{sys.executable} {program} {{cell}} {{data}} {{heldout}} {{answer}}")
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
    key = key_of(case, "case", 0, "salt")
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


def test_programs_side_by_side(answered: Path) -> None:
    """A rival who knows the keys beside a program that sees no gap: each its own score, one print."""
    own = answered / "answers" / "wizard"
    own.mkdir()
    keys = [read_json(path) for path in sorted((answered / "keys").glob("case_*.json"))]
    for key in keys:
        write_json(own / f"{key['case']}.json", perfect(key))
    runs = {key["case"]: {"status": "answered", "seconds": 1.0} for key in keys}
    commit_answers(answered, runs, ["by hand"], "wizard")
    result = score(answered)
    assert (result["program"], set(result["rivals"])) == ("diagnosis", {"wizard"})
    wizard = result["rivals"]["wizard"]
    assert (result["failed"], wizard["failed"]) == (1, 0)
    exact = {row["family"]: row for row in wizard["rates"] if row["figure"] == "named exactly"}
    assert all(row["hits"] == row["n"] for row in exact.values())
    assert wizard["coverage"]["n"] > 0
    alarms = next(row for row in wizard["rates"] if row["figure"] == "false alarms")
    assert alarms["n"] == sum(key["family"] == "null" for key in keys)
    json.dumps(result, allow_nan=False)
    console = Console(width=120, record=True, file=io.StringIO())
    show(console, result)
    printed = console.export_text()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 120
    line = next(x for x in printed.splitlines() if "false alarms" in x)
    assert line.split()[-1] == "0.0"
    runs.pop("case_0000")
    (own / "case_0003.json").unlink()
    with pytest.raises(BrokenSeal, match="case_0003"):
        opened(answered)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["run", "nowhere"], "no sealed cases"),
        (["run", "nowhere", "--answers", "aicc"], "nobody of that name"),
        (["run", "nowhere", "--answers", "a/b", "--command", "true"], "use letters"),
        (["score", "nowhere"], "no sealed cases"),
    ],
)
def test_faults_in_one_line(options: list[str], said: str, tmp_path: Path) -> None:
    options[1] = str(tmp_path / options[1])
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
    command = f'{sys.executable} -c "import time; time.sleep(20)"'
    runs = run(tmp_path / "one", command=command, limit=0.2)
    assert runs["case_0000"]["status"] == "too slow"
    assert opened(tmp_path / "one")[1]["diagnosis"].answers == {"case_0000": None}
