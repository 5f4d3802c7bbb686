"""The page in headless Chromium: no error, no request, no overflow, readable by all, printable."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

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
WIDTHS = (1280, 390)


@pytest.fixture(scope="module")
def html(demo_folder: Path) -> str:
    return (demo_folder / "report.html").read_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
def test_it_fits_and_asks_for_nothing(
    open_page: Callable[..., Any], html: str, width: int, scheme: str
) -> None:
    page = open_page(html, width=width, color_scheme=scheme)  # fails on errors and requests
    for details in page.query_selector_all("details"):
        details.evaluate("element => element.open = true")
    over = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.evaluate(over) <= 0
    cut = page.evaluate(
        """() => [...document.querySelectorAll("h1, h2, h3, p, li, figcaption, summary, .box")]
            .filter(e => e.offsetParent && e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"""
    )
    assert cut == []


# Of a table four rows, of a figure the first texts and marks: further ones are as these are.
THINNED = """() => {
    document.querySelectorAll("details").forEach(own => own.open = true);
    document.querySelectorAll("tbody").forEach(own => [...own.rows].slice(4).forEach(r => r.remove()));
    document.querySelectorAll("figure svg").forEach(svg => {
        const kept = new Set();
        for (const [kind, most] of [["text", 9]])
            for (let own of [...svg.querySelectorAll(kind)].slice(0, most)) {
                own.querySelectorAll("*").forEach(e => kept.add(e));
                for (; own !== svg; own = own.parentElement) kept.add(own);
            }
        svg.querySelectorAll("*").forEach(e => kept.has(e) || e.remove());
    }); }"""

RULES = {
    "light": {},
    "dark": {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}},
}
"""All; in dark colours those that ask for colours, since nothing else differs."""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault(open_page: Callable[..., Any], html: str, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = open_page(re.sub(r"<meta http-equiv[^>]*>", "", html), color_scheme=scheme)
    page.evaluate(THINNED)
    found = axe.run(page, options={"resultTypes": ["violations"], **RULES[scheme]}).response
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


def test_text_in_figures_stays_legible_and_words_whole_on_a_phone(
    open_page: Callable[..., Any], html: str
) -> None:
    page = open_page(html, width=390)
    heights = page.evaluate(
        """() => [...document.querySelectorAll("figure svg")].flatMap(svg => {
            const wide = svg.getBoundingClientRect().width;
            return wide ? [...svg.querySelectorAll("text")].map(text =>
                parseFloat(getComputedStyle(text).fontSize) * wide / svg.viewBox.baseVal.width) : [];
        })"""
    )
    assert min(heights) > 8.0
    broken = page.evaluate(
        """() => [...document.querySelectorAll("th, td, dd")].flatMap(cell => {
            const node = [...cell.childNodes].find(own => own.nodeType === 3), range = new Range();
            if (!node || !cell.offsetParent || cell.closest(".bars")) return [];
            return [...node.data.matchAll(/[A-Za-z_]{3,24}/g)].filter(({ index, 0: word }) => {
                range.setStart(node, index); range.setEnd(node, index + word.length);
                return new Set([...range.getClientRects()].map(box => box.top)).size > 1;
            }).map(found => found[0]); })"""
    )
    assert broken == []


def test_the_verdict_stands_on_the_first_screen(open_page: Callable[..., Any], html: str) -> None:
    for width, height in ((1280, 900), (390, 844)):
        page = open_page(html, width=width, height=height)
        box = page.locator(".verdict .change").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["y"] + box["height"] <= height
