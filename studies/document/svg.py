"""Figures within a page: SVG whose colours follow the page and whose poses can be highlighted."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from markupsafe import Markup

from studies.plots.style import POSE, Picture, svg_text

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_REFERS = re.compile(r"url\(#([^)]+)\)")
_THEMED = (
    (0x50, "var(--ink)"),
    (0xA8, "var(--soft)"),
    (0xC8, "var(--dim)"),
    (0xF0, "var(--faint)"),
    (0xFE, "var(--raised)"),
    (0xFF, "var(--paper)"),
)
"""Greys of the figures up to a lightness, by what they are on the page."""
_GREY = re.compile(r"#([0-9a-f]{2})\1\1(?![0-9a-f])", re.IGNORECASE)
_SMALLEST = (
    0.75  # of its width, to which a figure shrinks before it is scrolled: text stays legible
)
_LARGEST = 1.3  # of its width, to which it grows where there is room
_COLOURED = ("style", "fill", "stroke")


def inline_svg(picture: Picture, key: str, names: Mapping[str, str] | None) -> Markup:
    """The figure as an element of the page, labelled by its title and caption.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    names : pose -> the name under which it is highlighted; None where none is
    """
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    root = ET.fromstring(svg_text(picture))  # noqa: S314
    _clean(root, key, names)
    width, height = (float(root.attrib.pop(key).removesuffix("pt")) for key in ("width", "height"))
    root.set("class", "plot")
    root.set("role", "img")
    root.set("aria-label", f"{picture.title}. {picture.caption}")
    wide = width / 72.0 * 96.0
    root.set(
        "style",
        f"max-width: {_LARGEST * wide:.0f}px; min-width: {_SMALLEST * wide:.0f}px; "
        f"aspect-ratio: {width / height:.4f}",
    )
    text = ET.tostring(root, encoding="unicode")
    return Markup(text)  # noqa: S704 - drawn by matplotlib, which escapes what it writes


def _themed(grey: re.Match[str]) -> str:
    lightness = int(grey[1], 16)
    return next(name for most, name in _THEMED if lightness <= most)


def _clean(root: ET.Element, key: str, names: Mapping[str, str] | None) -> None:
    """Names of elements that are unique on the page, none that nobody refers to, no metadata."""
    for tag in ("metadata", "title", "desc"):
        for element in root.findall(f"{{{_SVG}}}{tag}"):
            root.remove(element)
    referred = set()
    for element in root.iter():
        for attribute, value in element.attrib.items():
            referred |= set(_REFERS.findall(value))
            if attribute.endswith("href") and value.startswith("#"):
                referred.add(value[1:])
    for element in root.iter():
        own = element.attrib.pop("id", None)
        if own is not None and own.startswith(POSE):
            pose = own.removeprefix(POSE)
            if names is not None:
                element.set("data-pose", names.get(pose, pose))
        elif own in referred:
            element.set("id", f"{key}-{own}")
        for attribute, value in element.attrib.items():
            if attribute in _COLOURED:
                value = _GREY.sub(_themed, value)
            value = _REFERS.sub(rf"url(#{key}-\1)", value)
            if attribute.endswith("href") and value.startswith("#"):
                value = f"#{key}-{value[1:]}"
            element.set(attribute, value)
