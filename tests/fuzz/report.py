"""What a page may not do, whatever texts its results hold."""

from __future__ import annotations

from html.parser import HTMLParser

_NEVER = ("img", "iframe", "object", "embed", "link", "base", "form", "applet", "audio", "video")
_OWN = ("data:image/png;base64,", "#")  # a picture is a cloud of points within a figure


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
    assert not outline.scripts, outline.scripts
