"""The box on top of a report: from where to where, by which tolerance, of whom and when."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from studies.cli import main
from studies.results import read
from tests.studies.examples import OLD, changed, old_fields


def box(page: Path) -> str:
    """The text of the box, tags left out; empty where there is none."""
    found = re.search(r'<div class="verdict[^>]*>.*?</dl></div>', page.read_text(), re.DOTALL)
    return "" if found is None else " ".join(re.sub(r"<[^>]*>", " ", found[0]).split())


def reported(result: Path, page: Path, *more: str) -> str:
    done = CliRunner().invoke(main, ["report", str(result), "-o", str(page), *more])
    assert done.exit_code == 0, done.output
    return box(page)


@pytest.fixture
def identified(demo_folder: Path, tmp_path: Path) -> dict[str, Any]:
    fields: dict[str, Any] = json.loads((demo_folder / "identify.json").read_text())
    return fields


def test_error_before_and_after_at_held_out_poses(
    identified: dict[str, Any], demo_folder: Path, tmp_path: Path
) -> None:
    """Both figures anew from the residuals."""
    held = [row for row in identified["residuals"] if row["heldout"]]
    before = np.sqrt(np.mean([np.square(row["nominal_mm"]).sum() for row in held]))
    after = identified["rms_mm"]["heldout"]
    said = reported(demo_folder / "identify.json", tmp_path / "p.html")
    assert f"from {before:.2f} mm \N{RIGHTWARDS ARROW} to {after:.4f} mm" in said
    assert "at held-out poses" in said
    assert not re.search("Pass|Fail|tolerance", said)
    assert "measured" not in said


@pytest.mark.parametrize(
    ("verdict", "word"),
    [("pass", "Pass"), ("fail", "Fail"), ("undecided", "Not decided"), (None, "Not decided")],
)  # fmt: skip
def test_outcome_by_the_tolerance(
    identified: dict[str, Any], tmp_path: Path, verdict: str | None, word: str
) -> None:
    identified["acceptance"] = {
        "tolerance_mm": 0.2, "rule": "simple", "verdict": verdict, "points": 48, "passed": 40,
        "failed": 8, "undecided": 0, "largest_mm": 0.345, "expanded_mm": 0.02,
    }  # fmt: skip
    identified["about"] = {"serial": "R-0815", "operator": "O. <N.>", "date": "2026-03-04"}
    result = tmp_path / "identify.json"
    result.write_text(json.dumps(identified))
    said = reported(result, tmp_path / "p.html")
    assert said.startswith(word)
    assert "Tolerance 0.2 mm" in said
    assert ("40 of 48 held-out points are within it" in said) == (verdict is not None)
    for told in ("R-0815", "O. &lt;N.&gt;", "2026-03-04"):
        assert told in said
    assert "2026-05-06" in reported(result, tmp_path / "p.html", "--date", "2026-05-06")


def test_the_day_is_that_of_readings_that_count_from_1970(
    demo_folder: Path, tmp_path: Path
) -> None:
    """2026-03-04 12:00 UTC is 1772625600 s."""
    for name in ("cell.toml", "kr270.urdf"):
        (tmp_path / name).write_bytes((demo_folder / name).read_bytes())
    lines = (demo_folder / "measurements.csv").read_text().splitlines()
    at = lines[0].split(",").index("time_s")
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = f"{1772625600.0 + float(row[at]):.1f}"
    text = "\n".join([lines[0], *(",".join(row) for row in rows), ""])
    (tmp_path / "day.csv").write_text(text)
    result = tmp_path / "r.json"
    call = [
        "identify",
        str(tmp_path / "cell.toml"),
        str(tmp_path / "day.csv"),
        "--json",
        str(result),
    ]
    assert CliRunner().invoke(main, call).exit_code == 0
    assert "measured 2026-03-04" in reported(result, tmp_path / "p.html")


@pytest.mark.parametrize(
    "kind", ["fleet", "identify", "compensate", "diagnose", "changes", "enough"]
)
def test_every_kind_with_errors_before_and_after(kind: str, tmp_path: Path) -> None:
    found = read(OLD / f"{kind}.json").error
    assert found is not None
    said = reported(OLD / f"{kind}.json", tmp_path / "p.html")
    assert found.name in said
    assert all(end in said for end in found.ends)


def test_what_the_tolerance_of_changes_and_the_goal_of_enough_say() -> None:
    moved = read(OLD / "changes.json").error
    assert moved is not None
    assert old_fields("changes")["verdict"] == "does_not"
    assert moved.judged is not None
    assert moved.judged.outcome == "fail"
    assert moved.before == old_fields("changes")["kept_rms_mm"]["value"]
    enough = read(OLD / "enough.json").error
    short = changed("enough", poses_to_goal=3).error
    for found, outcome in ((enough, "pass"), (short, "fail")):
        assert found is not None
        assert found.judged is not None
        assert found.judged.outcome == outcome


def test_without_a_measurement_there_is_no_box(tmp_path: Path) -> None:
    assert reported(OLD / "design.json", tmp_path / "p.html") == ""
