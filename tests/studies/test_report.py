"""The page: what is in it, what it leaves out and says so, that it needs nothing else; in Chromium."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import studies
from studies.render import short
from studies.results.identify import IdentifyResult
from studies.results.read import read, read_as
from tests.fuzz.small_cell import small_results
from tests.studies.command_line import check_harmless, ran, result, run, without_load
from tests.studies.test_results import written

MOST_BYTES = 400_000
ARROW = "\N{RIGHTWARDS ARROW}"


@pytest.fixture(scope="module")
def html(demo_folder: Path) -> str:
    return (demo_folder / "report.html").read_text()


def text_of(html: str) -> str:
    """The words of a page."""
    plain = re.sub(r"<style>.*?</style>|<svg.*?</svg>", "", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", plain)).split())


def reported(page: Path, *words: object) -> str:
    ran("report", *words, "-o", page)
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
    assert f"{ARROW} {short(identified['rms_mm']['heldout'])} mm" in text[:200]
    diagnosed = json.loads((demo_folder / "diagnose.json").read_text())
    assert f"Diagnosis: {short(diagnosed['gap']['heldout_before_mm'])}" in text[:300]
    assert text.index("What to do next Nothing remains beyond noise.") < text.index(
        "Identification"
    )
    assert html.index("What was identified") < html.index("<details>")
    drawn = re.findall(r"<svg [^>]*>", html)
    assert len(drawn) >= 5
    assert all('role="img"' in own and 'aria-label="' in own for own in drawn)
    assert html.count("<figcaption>") == len(drawn)
    for entry in identified["inputs"]:
        assert entry["sha256"] in text


def test_who_and_when(tmp_path: Path) -> None:
    call = ("report", written(tmp_path, "identified"), "-o", tmp_path / "page.html")
    about = {
        "--title": "Cell <7>", "--operator": "R. & D.", "--date": "2026-11-21",
        "--instrument": "tracker 0815",
    }  # fmt: skip
    words = [word for option in about.items() for word in option]
    fields, _ = result(tmp_path / "r.json", *call, *words)
    text = text_of((tmp_path / "page.html").read_text())
    assert all(own in text for own in about.values())
    assert (fields["command"], len(fields["inputs"])) == ("report", 1)


@pytest.mark.parametrize(
    ("verdict", "word"), [("pass", "Pass"), ("fail", "Fail"), (None, "Not decided")]
)
def test_outcome_by_the_tolerance(verdict: str | None, word: str, tmp_path: Path) -> None:
    largest = 0.345 if verdict else None
    own = {"tolerance_mm": 0.2, "verdict": verdict, "largest_mm": largest}
    about = {"serial": "R-0815", "operator": "O. <N.>", "date": "2026-03-04"}
    path = written(
        tmp_path,
        "identified",
        small_results()["identified"]
        | {"acceptance": own, "about": about, "warnings": ["it rained"]},
    )
    text = reported(tmp_path / "p.html", path)
    assert text.index(word) < text.index(ARROW)
    assert text.index("Warning: it rained.") < text.index("What to do next")
    assert "Tolerance 0.2 mm: " in text
    assert all(words in text for words in about.values())


@pytest.mark.parametrize("name", ["identified", "compensated", "diagnosed", "enough", "designed"])
def test_every_kind_with_errors_before_and_after(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name)
    found = read(path).error
    text = reported(tmp_path / "p.html", path)
    assert (found is None) == (name == "designed")
    assert ('class="verdict' in (tmp_path / "p.html").read_text()) == (found is not None)
    if found is not None:
        assert f"{found.name}, {found.ends[0]} {ARROW} {found.ends[1]}" in text
        assert ("This is the error of the fit." in text) == (name == "diagnosed")


def test_inputs_that_changed_or_differ_are_named(small: Path) -> None:
    cell, table = small / "cell.toml", small / "data.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-2]))
    ran("identify", cell, table, "--json", small / "fewer.json")
    before = written(small, "diagnosed")
    text = reported(small / "page.html", small / "fewer.json", before)
    assert "data.csv is another file in diagnosed.json than in fewer.json" in text
    cell.write_text(cell.read_text() + "\n")
    (small / "arm.urdf").unlink()
    text = reported(small / "page.html", written(small, "identified"))
    assert "cell.toml is changed since: the picture of the arm is left out" in text
    assert "not found" in text
    assert "What was identified" in text


def test_held_out_poses_may_be_called_as_the_fitted(small: Path) -> None:
    """Two tables of a session, each with p0, p1 ..: nothing is mixed up."""
    tables = {"first.csv": 0.0, "check.csv": 0.1}  # mm, by which x is off
    header, *rows = (line.split(",") for line in (small / "data.csv").read_text().splitlines())
    x = header.index("x_mm")
    for day, (name, off) in enumerate(tables.items()):
        lines = [[*header, "time_s"]]
        for row in rows:
            lines.append([*row, str(3600 * day)])
            lines[-1][x] = str(float(row[x]) + off)
        (small / name).write_text("\n".join(map(",".join, lines)))
    first, check = (small / name for name in tables)
    call = ("identify", small / "cell.toml", first, "--holdout", check)
    fields, _ = result(small / "renamed.json", *call)
    found = read_as(small / "renamed.json", IdentifyResult)
    assert [own.heldout for own in found.by_pose].count(True) == len(found.by_pose) / 2 == 8
    for held, key in ((False, "fitted_all"), (True, "heldout")):
        own = [pose for pose in found.by_pose if pose.heldout == held]
        squares = sum(pose.points * pose.after**2 for pose in own)
        rms = np.sqrt(squares / sum(pose.points for pose in own))
        assert rms == pytest.approx(fields["rms_mm"][key], rel=1e-9)
    hours = {(c.pose, c.heldout): c.variables["time [h]"] for c in found.conditions}
    assert hours["p1", True] == hours["p1", False] + 1.0


def test_a_model_that_is_worse_elsewhere_is_not_praised(small: Path) -> None:
    fields = small_results()["identified"]
    axes = ("x_mm", "y_mm", "z_mm")
    worse = [row | {axis: 1e3 * row[axis] for axis in axes} for row in fields["residuals"]]
    expected = fields["expected"] | {"model_mm": 0.0}  # a systematic error would be the cause
    path = written(small, "identified", fields | {"residuals": worse, "expected": expected})
    text = reported(small / "page.html", path)
    assert "What to do next Do not use this model." in text
    assert 'class="verdict fail"' in (small / "page.html").read_text()


def test_results_from_python(small: Path) -> None:
    """The same object as the command's: text, table, JSON, and a page in a line."""
    path = small / "cell.toml"
    without_load(path)
    cell = calib.load_cell(path)
    data = calib.load_measurements(cell, small / "data.csv")
    found = calib.identify(cell, data, heldout=0.3)
    own = studies.result_of(cell, found)
    done = run("identify", path, small / "data.csv", "--holdout", "0.3", "--json", "-")
    assert own.summary() in done.stderr
    assert repr(own) == own.summary()
    ours, theirs = json.loads(own.to_json()), json.loads(done.stdout)
    assert {k for k in ours if ours[k] != theirs[k]} <= {"inputs", "holdout"}
    studies.page(own, operator="N. N.").write(small / "x.html")
    assert "operator N. N." in text_of((small / "x.html").read_text())
    assert "<h2>" in own._repr_html_()
    value, std = found["tool:marker:m1.x"]
    entry = next(p for p in ours["parameters"] if p["id"] == "tool:marker:m1.x")
    assert (value * 1e3, std * 1e3) == pytest.approx((entry["value"], entry["std"]))
    none = r"no parameter 'tool:marker:m1\.w'; there is tool:marker:m1"
    with pytest.raises(calib.CalibError, match=none):
        found["tool:marker:m1.w"]
    with pytest.raises(calib.CalibError, match="found is a Cell; give one of"):
        studies.result_of(cell, cell)


# -- The page in headless Chromium: no error, no request, no overflow, readable by all, printable


OPTIONS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]


# Not for the whole session: while it runs, no other test of this process could run an event loop.
@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium: the system's, or the one that playwright brought."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
    with playwright.sync_playwright() as running:
        try:
            browser = running.chromium.launch(executable_path=found, args=OPTIONS)
        except playwright.Error as error:
            pytest.skip(f"Chromium does not start: {str(error).splitlines()[0]}")
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """A function that opens HTML text: (html, width=1280, height=900, **context options) -> page."""
    contexts: list[Any] = []
    faults: list[str] = []

    def opened(html: str, width: int = 1280, height: int = 900, **options: Any) -> Any:
        file = tmp_path / f"page{len(contexts)}.html"
        file.write_text(html, encoding="utf-8")
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        context.set_default_timeout(10_000)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("console", lambda said: faults.append(f"console {said.type}: {said.text}"))
        page.on("dialog", lambda dialog: (faults.append("dialog"), dialog.dismiss()))
        page.on(
            "request",
            lambda request: request.url == file.as_uri() or faults.append(f"asks {request.url}"),
        )
        page.goto(file.as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()
    assert not faults, faults


PAGES = 11
CUT = """() => [...document.querySelectorAll("h1, h2, h3, p, li, figcaption, summary, .box")]
    .filter(e => e.offsetParent && e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"""
BROKEN = """() => [...document.querySelectorAll("th, td, dd")].flatMap(cell => {
    const node = [...cell.childNodes].find(own => own.nodeType === 3), range = new Range();
    if (!node || !cell.offsetParent || cell.closest(".bars")) return [];
    return [...node.data.matchAll(/[A-Za-z_]{3,24}/g)].filter(({ index, 0: word }) => {
        range.setStart(node, index); range.setEnd(node, index + word.length);
        return new Set([...range.getClientRects()].map(box => box.top)).size > 1;
    }).map(found => found[0]); })"""
LETTERS = """() => [...document.querySelectorAll("figure svg")].flatMap(svg => {
    const wide = svg.getBoundingClientRect().width;
    return wide ? [...svg.querySelectorAll("text")].map(text =>
        parseFloat(getComputedStyle(text).fontSize) * wide / svg.viewBox.baseVal.width) : []; })"""


@pytest.mark.parametrize(("width", "height", "scheme"), [(1280, 900, "light"), (390, 844, "dark")])
def test_it_fits_and_asks_for_nothing(
    open_page: Callable[..., Any], html: str, width: int, height: int, scheme: str
) -> None:
    page = open_page(html, width, height, color_scheme=scheme)  # fails on errors and requests
    box = page.locator(".verdict .change").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= width
    assert box["y"] + box["height"] <= height, "the verdict stands on the first screen"
    assert page.evaluate(BROKEN) == [], "words are whole"
    assert min(page.evaluate(LETTERS)) > 8.0, "px"
    for details in page.query_selector_all("details"):
        details.evaluate("element => element.open = true")
    over = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.evaluate(over) <= 0
    assert page.evaluate(CUT) == []


# Of a table four rows, of a figure the first texts: further ones are as these are.
THINNED = """() => {
    document.querySelectorAll("details").forEach(own => own.open = true);
    document.querySelectorAll("tbody").forEach(own => [...own.rows].slice(4).forEach(r => r.remove()));
    document.querySelectorAll("figure svg").forEach(svg => {
        const kept = new Set();
        for (let own of [...svg.querySelectorAll("text")].slice(0, 9)) {
            own.querySelectorAll("*").forEach(e => kept.add(e));
            for (; own !== svg; own = own.parentElement) kept.add(own);
        }
        svg.querySelectorAll("*").forEach(e => kept.has(e) || e.remove());
    }); }"""

COLOURS = {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}}
"""Of the rules those that ask for colours: nothing else differs in dark ones."""


@pytest.mark.parametrize(("scheme", "rules"), [("light", {}), ("dark", COLOURS)])
def test_axe_finds_no_serious_fault(
    open_page: Callable[..., Any], html: str, scheme: str, rules: dict[str, Any]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = open_page(re.sub(r"<meta http-equiv[^>]*>", "", html), color_scheme=scheme)
    page.evaluate(THINNED)
    found = axe.run(page, options={"resultTypes": ["violations"], **rules}).response
    assert found["passes"], "it looked"
    serious = [
        (v["id"], [node["html"][:200] for node in v["nodes"]][:3])
        for v in found["violations"]
        if v["impact"] in ("serious", "critical")
    ]
    assert serious == []


def test_it_prints_on_few_pages(open_page: Callable[..., Any], html: str) -> None:
    pdf = open_page(html).pdf(format="A4")
    assert 1 <= len(re.findall(rb"/Type\s*/Page[^s]", pdf)) <= PAGES
