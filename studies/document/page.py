"""The long form: every part as HTML, figures within it as SVG whose colours follow the page."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

from markupsafe import Markup

from studies.document import (
    Column,
    Detail,
    Figure,
    Lines,
    Part,
    Raw,
    Rule,
    Section,
    Sentence,
    Table,
    plural,
)
from studies.plots.style import Picture, svg_text

if TYPE_CHECKING:
    from jinja2 import Template


_FOLDED = 16  # rows from which on a table is folded
_SORTED = 6  # rows from which on a table can be sorted
_COMMAND = re.compile(r"`([^`]*)`")
_JOINTS = re.compile(r"(?<=\w)[_:,](?=\w)|@(?=[\w-])|/(?=\w{4}|\()|\.(?=[a-z]{4})|\w{16}(?=\w{8})")
_UNIT = re.compile(r" (\[[^\[\]]{1,12}\])$")  # longer ones may break
_BROAD = 6.0  # inches: a wider figure takes a line of its own on paper
Cell: TypeAlias = str | float | int | None
_NUMBER = re.compile(  # linear in the length of a text, which may be a hostile name
    r"^(?:[\s.,eE+\N{MINUS SIGN}\N{PLUS-MINUS SIGN}%x-]*\d)+[\s.,eE+\-%]*$"
)
_MINUS = str.maketrans("-", "\N{MINUS SIGN}")


@dataclass(frozen=True, eq=False)
class Writer:
    """What turns parts into HTML, for one page.

    macros : of ``parts.html.j2``; numbers : of the figures, each once on a page
    """

    macros: Any
    numbers: Iterator[int]

    @classmethod
    def fresh(cls) -> Writer:
        """One for a page of its own."""
        return cls(template("studies.document", "parts.html.j2").module, count())

    def section(self, section: Section) -> Markup:
        """The parts of a section."""
        return self._parts(section.parts)

    def _parts(self, parts: Iterable[Part]) -> Markup:
        found = []
        for kind, group in groupby(parts, type):
            if kind is Sentence:
                found.append(self._sentences(group))  # type: ignore[arg-type]
            else:
                found += [self._part(part) for part in group]
        return Markup("\n").join(found)

    def _sentences(self, sentences: Iterable[Sentence]) -> Markup:
        """Plain ones as paragraphs; from the first label on, a list of what is said of each."""
        labelled: list[tuple[str, list[Sentence]]] = []
        plain = []
        for sentence in sentences:
            if sentence.label:
                label = sentence.label[:1].upper() + sentence.label[1:]
                labelled.append((label, [sentence]))
            elif labelled:
                labelled[-1][1].append(sentence)
            else:
                plain.append(sentence)
        made: Markup = self.macros.sentences(plain, labelled)
        return made

    def _part(self, part: Part) -> Markup:
        if isinstance(part, Table):
            if not part.rows:
                return Markup()
            table = self._table(part)
            name = f"{part.name or part.caption} ({len(part.rows)})"
            fold = len(part.rows) > _FOLDED if part.fold is None else part.fold
            return self._folded(name, table, part.paper) if fold else table
        if isinstance(part, Figure):
            return self._figure(part)
        if isinstance(part, Detail):
            inner = self._parts(part.parts)
            return self._folded(part.title, inner) if part.title else inner
        if isinstance(part, Lines):
            return Markup("<pre>{}</pre>").format(part.text)
        if isinstance(part, Raw):
            return part.html
        raise TypeError(f"no part of a document: {part!r}")

    def _folded(self, title: str, inner: Markup, paper: bool = False) -> Markup:
        made: Markup = self.macros.folded(title, inner, paper)
        return made

    def _table(self, table: Table[Any]) -> Markup:
        right = [column.rule.number for column in table.columns]
        cells = [[_cell(column, row) for column in table.columns] for row in table.rows]
        heads = [_head(column) for column in table.columns]
        can_sort = len(cells) > _SORTED and bool(heads[0])
        label = table.caption or table.name or "table"
        made: Markup = self.macros.table(heads, right, cells, table.caption, label, can_sort)
        return made

    def _figure(self, figure: Figure) -> Markup:
        picture = figure.draw()
        drawn = inline_svg(picture, f"f{next(self.numbers)}")
        below = Markup()
        if picture.rows:
            title = f"The numbers: {plural(len(picture.rows), 'row')}"
            columns = plain_columns(picture.header, picture.rows)
            below = self._folded(title, self._table(Table(columns, picture.rows, title)))
        broad = picture.figure.get_figwidth() > _BROAD
        made: Markup = self.macros.figure(picture.title, picture.caption, drawn, below, broad)
        return made


def plain_columns(
    header: Sequence[str], rows: Sequence[Sequence[Cell]]
) -> tuple[Column[Sequence[Any]], ...]:
    """A column for each title; those stand right that hold nothing but numbers."""
    return tuple(
        Column(title, itemgetter(i), Rule(_signed, "", all(_numeric(row[i]) for row in rows)))
        for i, title in enumerate(header)
    )


def table_of(
    header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = ""
) -> Table[Sequence[Any]]:
    """A table that stands open, of what no record tells."""
    return Table(plain_columns(header, rows), rows, caption=caption, fold=False)


def _numeric(cell: Cell) -> bool:
    return not isinstance(cell, str) or not cell or bool(_NUMBER.match(cell))


def _signed(value: Cell) -> str:
    """Numbers with a true minus sign, among names too."""
    text = shown(value)
    return text.replace("-", "\N{MINUS SIGN}") if _NUMBER.match(text) else text


def shown(value: Cell) -> str:
    """A cell as text: four digits, nothing for what is undefined.

    >>> shown(0.0123456), shown(None), shown(12), shown("m1")
    ('0.01235', '', '12', 'm1')
    """
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    return f"{value:.4g}" if math.isfinite(value) else ""


def _head(column: Column[Any]) -> str:
    title = column.title.replace("\n", " ")
    return f"{title} [{column.unit}]" if column.unit else title


def _cell(column: Column[Any], row: Any) -> str:
    text = column.cell(row)
    if not column.rule.number:
        return text
    return text.translate(_MINUS).replace(" to ", "\N{NO-BREAK SPACE}to ")


def template(package: str, name: str) -> Template:
    """A template beside a package's modules, in which all text is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"breakable": breakable, "headed": _headed}
    return environment.get_template(name)


def breakable(text: str) -> Markup:
    """Text whose long names may break after a joint of theirs, and hashes anywhere; commands as code.

    >>> str(breakable("base_drift:base")), str(breakable("a & b")), str(breakable("run `posecal`"))
    ('base_<wbr>drift:<wbr>base', 'a &amp; b', 'run <code>posecal</code>')
    """
    code = Markup("<code>{}</code>")
    words = _COMMAND.split(text)  # every second one is a command
    return Markup().join(code.format(w) if k % 2 else _broken(w) for k, w in enumerate(words))


def _broken(text: str) -> Markup:
    parts = _JOINTS.sub(lambda joint: f"{joint[0]}\0", text.replace(" m)", "\N{NO-BREAK SPACE}m)"))
    return Markup("<wbr>").join(parts.split("\0"))


def _headed(text: str) -> Markup:
    """The head of a column; its unit stays in one line."""
    unit = _UNIT.search(text)
    if unit is None:
        return breakable(text)
    whole = Markup(" <span class=unit>{}</span>").format(unit[1])
    return breakable(text[: unit.start()]) + whole


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


def inline_svg(picture: Picture, key: str) -> Markup:
    """The figure as an element of the page, labelled by its title and caption.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    root = ET.fromstring(svg_text(picture))  # noqa: S314
    _clean(root, key)
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


def _clean(root: ET.Element, key: str) -> None:
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
        if own in referred:
            element.set("id", f"{key}-{own}")
        for attribute, value in element.attrib.items():
            if attribute in _COLOURED:
                value = _GREY.sub(_themed, value)
            value = _REFERS.sub(rf"url(#{key}-\1)", value)
            if attribute.endswith("href") and value.startswith("#"):
                value = f"#{key}-{value[1:]}"
            element.set(attribute, value)
