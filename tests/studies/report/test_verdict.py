"""The box on top of a report: from where to where, by which tolerance, of whom and when."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies.document import Raw
from studies.report.summary import Bar, bars
from studies.results.read import read
from tests.fuzz.small_cell import small_results
from tests.studies.command_line import run

pytestmark = pytest.mark.usefixtures("without_figures")


def box(page: Path) -> str:
    """The text of the box, tags left out; empty where there is none."""
    found = re.search(r'<div class="verdict[^>]*>.*?</dl></div>', page.read_text(), re.DOTALL)
    return "" if found is None else " ".join(re.sub(r"<[^>]*>", " ", found[0]).split())


def reported(result: Path, page: Path, *more: str) -> str:
    done = run("report", result, "-o", page, *more)
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
    [("pass", "Pass"), ("fail", "Fail"), (None, "from")],
)  # fmt: skip
def test_outcome_by_the_tolerance(
    identified: dict[str, Any], tmp_path: Path, verdict: str | None, word: str
) -> None:
    identified["acceptance"] = {
        "tolerance_mm": 0.2, "verdict": verdict, "largest_mm": verdict and 0.345,
    }  # fmt: skip
    identified["about"] = {"serial": "R-0815", "operator": "O. <N.>", "date": "2026-03-04"}
    result = tmp_path / "identify.json"
    result.write_text(json.dumps(identified))
    said = reported(result, tmp_path / "p.html")
    assert said.startswith(word)
    assert ("Tolerance 0.2 mm: the largest error of held-out" in said) == (verdict is not None)
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
    done = run("identify", tmp_path / "cell.toml", tmp_path / "day.csv", "--json", result)
    assert done.exit_code == 0
    assert "measured 2026-03-04" in reported(result, tmp_path / "p.html")


def written(name: str, folder: Path, **changed: Any) -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps({**small_results()[name], **changed}))
    return path


@pytest.mark.parametrize("name", ["identified", "compensated", "diagnosed", "enough"])
def test_every_kind_with_errors_before_and_after(name: str, tmp_path: Path) -> None:
    path = written(name, tmp_path)
    found = read(path).error
    assert found is not None
    said = reported(path, tmp_path / "p.html")
    assert found.name in said
    assert all(end in said for end in found.ends)


@pytest.mark.parametrize(("more", "outcome"), [(0, "pass"), (1, "fail")])
def test_what_the_goal_of_enough_says(more: int, outcome: str, tmp_path: Path) -> None:
    found = read(written("enough", tmp_path, poses_to_goal=more)).error
    assert found is not None
    assert found.judged is not None
    assert found.judged.outcome == outcome


def test_without_a_measurement_there_is_no_box(tmp_path: Path) -> None:
    assert reported(written("designed", tmp_path), tmp_path / "p.html") == ""


# -- Bars on a log scale ---------------------------------------------------------------------------


def widths(drawn: Raw) -> list[float]:
    return [float(width) for width in re.findall(r"width: ([\d.]+)%", drawn.html)]


def test_equal_ratios_are_equal_steps_and_the_noise_is_a_line() -> None:
    drawn = bars(
        [
            Bar("nominal", 4.0, "bad"),
            Bar("identified", 0.4, "good"),
            Bar("explained", 0.04, "good"),
            Bar("noise", 0.02, "floor"),
        ],
        "What is left.",
    )
    first, second, third, noise = widths(drawn)
    assert first == 100.0
    assert first - second == pytest.approx(second - third, abs=0.02)
    assert noise > 5.0, "the least is seen"
    assert re.findall(r'<i style="left: ([\d.]+)%', drawn.html) == [f"{noise:.2f}"] * 4
    assert re.findall(r">([\d.e+-]+)</span>", drawn.html) == ["0.1", "1"]
    assert re.findall(r'number">([\d.]+)', drawn.html) == ["4.00", "0.400", "0.0400", "0.0200"]
