"""The page: what stands in it, what it leaves out and says so, and that nothing in it can do harm."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies.identify.record import IdentifyRecord
from studies.identify.telling import point_errors
from studies.report.evidence import load_evidence
from studies.results.read import read_as
from tests.studies.command_line import run


class Outline(HTMLParser):
    """Elements, ids, references and text of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.sections: list[str] = []
        self.links: list[str] = []
        self.tags: dict[str, int] = {}
        self.handlers: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags[tag] = self.tags.get(tag, 0) + 1
        if given.get("id"):
            self.ids.append(str(given["id"]))
        if tag == "section":
            self.sections.append(str(given["id"]))
        for key in ("href", "src", "xlink:href"):
            if given.get(key):
                self.links.append(str(given[key]))
        self.handlers += [key for key, _ in attrs if key.startswith("on")]


@pytest.fixture(scope="module")
def html(demo_folder: Path) -> str:
    return (demo_folder / "report.html").read_text()


@pytest.fixture(scope="module")
def outline(html: str) -> Outline:
    return Outline(html)


def test_every_section_is_there_and_in_the_contents(outline: Outline) -> None:
    assert outline.sections == [
        "summary", "arm", "cell", "plan", "sight", "alike", "approaches", "errors", "parameters",
        "budget", "against", "diagnosis", "unseen", "provenance",
    ]  # fmt: skip
    assert {f"#{key}" for key in outline.sections} <= set(outline.links)


def test_it_needs_nothing_from_outside(html: str, outline: Outline) -> None:
    assert all(link.startswith(("#", "data:")) for link in outline.links)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert not re.findall(r"url\((?!['\"]?#|['\"]?data:)", html)
    assert not re.findall(r"@import|fetch\(|XMLHttpRequest|WebSocket|sendBeacon|import\(", html)
    assert "default-src 'none'" in html
    assert outline.handlers == []


def test_figures_are_described_and_have_their_numbers(html: str, outline: Outline) -> None:
    drawn = re.findall(r'<svg[^>]*class="plot"[^>]*>', html)
    assert len(drawn) >= 8
    assert all('role="img"' in svg and "aria-label=" in svg for svg in drawn)
    assert html.count("<summary>The numbers:") == len(drawn)
    assert outline.tags["figcaption"] > len(drawn)  # that of the arm too


def test_figures_of_the_results_stand_in_it(demo_folder: Path, html: str) -> None:
    text = re.sub(r"\s+", " ", html.replace("<wbr>", ""))
    identified = json.loads((demo_folder / "identify.json").read_text())
    designed = json.loads((demo_folder / "design.json").read_text())
    assert f"to {identified['rms_mm']['heldout']:.4f} mm" in text
    share = int(1e4 * designed["efficiency"]) / 100.0
    assert f"Certified efficiency {share:.2f} %" in text
    for entry in identified["inputs"]:
        assert entry["sha256"] in text
    for p in identified["parameters"]:
        digits = f"{abs(p['value']):.4g}"[:4].rstrip(".")
        assert digits in text, p["id"]


@pytest.mark.usefixtures("without_figures")
def test_who_and_when(demo_folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    done = run(
        "report", demo_folder / "compare.json", "-o", page, "--title", "Cell <7>",
        "--operator", "R. & D.", "--date", "2026-11-21", "--instrument", "tracker 0815",
        "--json", tmp_path / "r.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    text = page.read_text()
    for told in ("Cell &lt;7&gt;", "R. &amp; D.", "2026-11-21", "tracker 0815"):
        assert told in text
    fields = json.loads((tmp_path / "r.json").read_text())
    assert fields["command"] == "report"
    assert fields["inputs"][0]["file"].endswith("compare.json")
    assert Outline(text).sections == ["summary", "cell", "approaches", "provenance"]


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
    (moved / "kr270.urdf").unlink()
    done = run("report", moved / "identify.json", "-o", moved / "page.html")
    assert done.exit_code == 0, done.output
    text = re.sub(r"\s+", " ", (moved / "page.html").read_text().replace("<wbr>", ""))
    assert "measurements.csv is changed since: figures that need it are left out" in text or (
        "the cell is left out" in text
    )
    assert "not found" in text
    assert "errors" in Outline(text).sections


def _with(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    fields = json.loads(path.read_text())
    change(fields)
    path.write_text(json.dumps(fields))


def test_held_out_poses_may_be_called_as_the_fitted(moved: Path) -> None:
    """Two tables of a session, each with p01, p02 ..: nothing is mixed up."""
    check = moved / "check.csv"
    check.write_text(re.sub(r"^c(\d\d)", r"p\1", check.read_text(), flags=re.M))
    result = moved / "renamed.json"
    done = run(
        "identify", moved / "cell.toml", moved / "measurements.csv", "--holdout", check,
        "--json", result,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    fields = json.loads(result.read_text())
    errors = point_errors(read_as(result, IdentifyRecord))
    assert (len(errors.poses), int(errors.heldout.sum())) == (46, 16)
    for held, key in ((False, "fitted_all"), (True, "heldout")):
        own = errors.take(errors.heldout == held)
        rms = 1e3 * np.sqrt((own.after**2).sum() / own.seen.sum())
        assert rms == pytest.approx(fields["rms_mm"][key], rel=1e-9)
    evidence = load_evidence([result])
    measured = evidence.data[result]
    assert measured.heldout is not None
    at = measured.reading("p01_free (held out)", True)
    assert at is not None
    assert at[0] is measured.heldout.poses


@pytest.mark.usefixtures("without_figures")
def test_results_that_do_not_belong_together_are_said_to(moved: Path) -> None:
    table = moved / "measurements.csv"
    rows = table.read_text().splitlines(keepends=True)
    table.write_text("".join(rows[:-3]))
    run("identify", moved / "cell.toml", table, "--json", moved / "fewer.json")
    done = run("report", moved / "fewer.json", moved / "diagnose.json", "-o", moved / "page.html")
    assert done.exit_code == 0, done.output
    text = re.sub(r"\s+", " ", (moved / "page.html").read_text().replace("<wbr>", ""))
    assert "measurements.csv is another file in diagnose.json than in fewer.json" in text


@pytest.mark.usefixtures("without_figures")
def test_a_model_that_is_worse_elsewhere_is_not_praised(moved: Path) -> None:
    def spoil(fields: dict[str, Any]) -> None:
        for row in fields["residuals"]:
            row |= {axis: 1e3 * row[axis] for axis in ("x_mm", "y_mm", "z_mm")}
        rows = fields["budget"]["rows"]  # which tell of a systematic error, and so of the cause
        fields["budget"]["rows"] = [row for row in rows if row["part_of"] != "model"]

    _with(moved / "identify.json", spoil)
    run("report", moved / "identify.json", "-o", moved / "page.html")
    text = (moved / "page.html").read_text()
    summary = text[text.index('<section id="summary"') : text.index('<section id="arm"')]
    assert "Do not use this model." in summary
    assert "box good" not in summary
