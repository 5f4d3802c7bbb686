"""The page: what is in it, what it leaves out and says so, and that it needs nothing else."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies.page import _evidence, _reported, _variables
from studies.render import short
from studies.results.identify import IdentifyResult
from studies.results.read import read, read_as
from tests.fuzz.report import check_harmless
from tests.fuzz.small_cell import small_results
from tests.studies.command_line import run

MOST_BYTES = 400_000


@pytest.fixture(scope="module")
def html(demo_folder: Path) -> str:
    return (demo_folder / "report.html").read_text()


def text_of(html: str) -> str:
    """The words of a page."""
    plain = re.sub(r"<style>.*?</style>|<svg.*?</svg>", "", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", plain)).split())


def reported(page: Path, *words: object) -> str:
    done = run("report", *words, "-o", page)
    assert done.exit_code == 0, done.output
    return text_of(page.read_text())


def test_it_is_small_and_needs_nothing_from_outside(html: str) -> None:
    assert len(html.encode()) <= MOST_BYTES
    check_harmless(html)
    assert not re.findall(r"url\((?!['\"]?#|['\"]?data:)", html)
    assert not re.findall(r"@import|fetch\(|XMLHttpRequest|import\(", html)
    assert "default-src 'none'" in html
    ids = re.findall(r' id="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    assert {ref[1:] for ref in re.findall(r'href="(#[^"]+)"', html)} <= set(ids)


def test_the_answer_stands_first_and_figures_are_described(html: str, demo_folder: Path) -> None:
    text, identified = text_of(html), json.loads((demo_folder / "identify.json").read_text())
    after = short(identified["rms_mm"]["heldout"])
    assert f"\N{RIGHTWARDS ARROW} {after} mm" in text[:200]
    assert text.index("What to do next") < text.index("Identification")
    assert html.index("What was identified") < html.index("<details>")
    drawn = re.findall(r"<svg [^>]*>", html)
    assert len(drawn) >= 5
    assert all('role="img"' in own and 'aria-label="' in own for own in drawn)
    assert html.count("<figcaption>") == len(drawn)
    for entry in identified["inputs"]:
        assert entry["sha256"] in text


def test_who_and_when(demo_folder: Path, tmp_path: Path) -> None:
    result = tmp_path / "r.json"
    text = reported(
        tmp_path / "page.html", demo_folder / "identify.json", "--title", "Cell <7>", "--json", result,
        "--operator", "R. & D.", "--date", "2026-11-21", "--instrument", "tracker 0815",
    )  # fmt: skip
    for words in ("Cell <7>", "R. & D.", "2026-11-21", "tracker 0815"):
        assert words in text
    fields = json.loads(result.read_text())
    assert fields["command"] == "report"
    assert fields["inputs"][0]["file"].endswith("identify.json")


@pytest.mark.parametrize(
    ("verdict", "word"), [("pass", "Pass"), ("fail", "Fail"), (None, "Not decided")]
)
def test_outcome_by_the_tolerance(verdict: str | None, word: str, tmp_path: Path) -> None:
    largest = 0.345 if verdict else None
    own = {"tolerance_mm": 0.2, "verdict": verdict, "largest_mm": largest}
    about = {"serial": "R-0815", "operator": "O. <N.>", "date": "2026-03-04"}
    text = reported(
        tmp_path / "p.html", written("identified", tmp_path, acceptance=own, about=about)
    )
    assert text.index(word) < text.index("\N{RIGHTWARDS ARROW}")
    assert "Tolerance 0.2 mm: " in text
    assert all(words in text for words in about.values())


def written(name: str, folder: Path, **changed: Any) -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps({**small_results()[name], **changed}))
    return path


@pytest.mark.parametrize("name", ["identified", "compensated", "diagnosed", "enough"])
def test_every_kind_with_errors_before_and_after(name: str, tmp_path: Path) -> None:
    path = written(name, tmp_path)
    found = read(path).error
    assert found is not None
    text = reported(tmp_path / "p.html", path)
    assert f"{found.name}, {found.ends[0]} \N{RIGHTWARDS ARROW} {found.ends[1]}" in text


def test_without_a_measurement_there_is_no_box(tmp_path: Path) -> None:
    reported(tmp_path / "p.html", written("designed", tmp_path))
    assert 'class="verdict' not in (tmp_path / "p.html").read_text()


@pytest.fixture
def moved(demo_folder: Path, tmp_path: Path) -> Path:
    """The results with their inputs in another place, where they are looked for beside them."""
    folder = tmp_path / "moved"
    shutil.copytree(demo_folder, folder)
    for file in folder.glob("*.json"):
        fields = json.loads(file.read_text())
        for entry in fields.get("inputs", []):
            entry["file"] = f"elsewhere/{Path(entry['file']).name}"
        file.write_text(json.dumps(fields))
    return folder


def test_changed_inputs_are_left_out_and_named(moved: Path) -> None:
    table = moved / "measurements.csv"
    table.write_text(table.read_text() + "\n")
    text = reported(moved / "page.html", moved / "identify.json")
    assert "measurements.csv is changed since: figures that need it are left out" in text
    (moved / "kr270.urdf").unlink()
    text = reported(moved / "page.html", moved / "identify.json")
    assert "the cell is left out" in text
    assert "not found" in text
    assert "What was identified" in text


def test_results_that_do_not_belong_together_are_said_to(moved: Path) -> None:
    table = moved / "measurements.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-3]))
    run("identify", moved / "cell.toml", table, "--json", moved / "fewer.json")
    text = reported(moved / "page.html", moved / "fewer.json", moved / "diagnose.json")
    assert "measurements.csv is another file in diagnose.json than in fewer.json" in text


def test_held_out_poses_may_be_called_as_the_fitted(moved: Path) -> None:
    """Two tables of a session, each with p01, p02 ..: nothing is mixed up."""
    check, result = moved / "check.csv", moved / "renamed.json"
    check.write_text(re.sub(r"^c(\d\d)", r"p\1", check.read_text(), flags=re.M))
    cell, table = moved / "cell.toml", moved / "measurements.csv"
    done = run("identify", cell, table, "--holdout", check, "--json", result)
    assert done.exit_code == 0, done.output
    found = read_as(result, IdentifyResult)
    poses, fields = found.by_pose, json.loads(result.read_text())
    assert (len(poses), sum(own.heldout for own in poses)) == (46, 16)
    for held, key in ((False, "fitted_all"), (True, "heldout")):
        own = [pose for pose in poses if pose.heldout == held]
        squares = sum(pose.points * pose.after**2 for pose in own)
        rms = np.sqrt(squares / sum(pose.points for pose in own))
        assert rms == pytest.approx(fields["rms_mm"][key], rel=1e-9)
    time = (_variables(_evidence(_reported(result))) or {})["time [h]"]
    assert time["p01_free", True] > time["p01_free", False]


def test_the_day_is_that_of_readings_that_count_from_1970(moved: Path) -> None:
    """2026-03-04 12:00 UTC is 1772625600 s."""
    table = moved / "measurements.csv"
    lines = table.read_text().splitlines()
    at = lines[0].split(",").index("time_s")
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = f"{1772625600.0 + float(row[at]):.1f}"
    table.write_text("\n".join([lines[0], *(",".join(row) for row in rows), ""]))
    done = run("identify", moved / "cell.toml", table, "--json", moved / "r.json")
    assert done.exit_code == 0, done.output
    assert "measured 2026-03-04" in reported(moved / "p.html", moved / "r.json")


def _with(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    fields = json.loads(path.read_text())
    change(fields)
    path.write_text(json.dumps(fields))


def test_a_model_that_is_worse_elsewhere_is_not_praised(moved: Path) -> None:
    def spoil(fields: dict[str, Any]) -> None:
        for row in fields["residuals"]:
            row |= {axis: 1e3 * row[axis] for axis in ("x_mm", "y_mm", "z_mm")}
        rows = fields["budget"]["rows"]  # of a systematic error, which would be the cause
        fields["budget"]["rows"] = [row for row in rows if row["part_of"] != "model"]

    _with(moved / "identify.json", spoil)
    text = reported(moved / "page.html", moved / "identify.json")
    assert "What to do next Do not use this model." in text
    assert 'class="verdict fail"' in (moved / "page.html").read_text()
