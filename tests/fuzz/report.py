"""The page that results become: none of their texts may do anything in it.

Drawing takes hundreds of times as long as all the rest, so that only a few inputs are drawn, chosen by
their own bytes: the same input takes the same way again. All are read, told and turned into HTML.
"""

from __future__ import annotations

import json
import zlib
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import patch

from markupsafe import Markup

from studies.document import page as document_page
from studies.report import page
from studies.report.page import report_page
from tests.fuzz.small_cell import put_small_cell, small_results

_DRAWN = 32  # one input of so many
_NEVER = ("img", "iframe", "object", "embed", "link", "base", "form", "applet", "audio", "video")
_OWN = ("data:image/png;base64,", "#")  # a picture is a cloud of points within a figure


def report(folder: Path, content: bytes) -> object:
    """A list of results, each its own file; bytes that are no list are a file by themselves."""
    put_small_cell(folder)
    try:
        found = json.loads(content)
        texts = [json.dumps(entry).encode() for entry in found] if isinstance(found, list) else []
    except (ValueError, RecursionError):
        texts = []
    paths = []
    for number, text in enumerate(texts[:8] or [content]):
        paths.append(folder / f"result{number}.json")
        paths[-1].write_bytes(text)
    if zlib.crc32(content) % _DRAWN:
        with patch.object(document_page, "inline_svg", lambda *_: Markup("<svg></svg>")):
            html, _ = report_page(paths, None, {})
    else:
        html, _ = report_page(paths, None, {})
    check_harmless(html)
    return html


class _Outline(HTMLParser):
    """What a page could do."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.scripts: dict[str, int] = {}
        self.harm: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            kind = dict(attrs).get("type") or ""
            self.scripts[kind] = self.scripts.get(kind, 0) + 1
        if tag in _NEVER:
            self.harm.append(tag)
        for key, value in attrs:
            reference = key.endswith(("href", "src", "action", "srcdoc", "data"))
            if key.startswith("on") or (reference and not (value or "").startswith(_OWN)):
                self.harm.append(f"{tag} {key}={value!s:.80}")
            if (
                key == "style"
                and value
                and ("url(" in value.replace("url(#", "") or "@import" in value)
            ):
                self.harm.append(f"{tag} {key}={value!s:.80}")


def check_harmless(html: str) -> None:
    """Raise AssertionError where a page has scripts, events or references beyond its own."""
    outline = _Outline()
    outline.feed(html)
    outline.close()
    assert not outline.harm, outline.harm
    assert outline.scripts.get("", 0) == len(page._SCRIPTS), outline.scripts
    assert outline.scripts.get("application/json", 0) <= 1, outline.scripts
    assert set(outline.scripts) <= {"", "application/json"}, outline.scripts


def reports() -> tuple[str, ...]:
    """Each result by itself, and pages of several."""
    made = small_results()
    pages = [[result] for result in made.values()]
    pages += [[made["identified"], made["compensated"]], [made["designed"], made["diagnosed"]]]
    return tuple(json.dumps(results) for results in pages)
