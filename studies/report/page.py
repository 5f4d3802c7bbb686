"""The page: sections in a frame, styles and scripts within it, so that it needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from studies.document.page import Writer
from studies.report.assets import asset
from studies.report.evidence import Evidence
from studies.report.sections import Placed, sections

_STYLES = ("page.css", "highlight.css", "arm_view.css")
_SCRIPTS = ("page.js", "arm_view.js")


@dataclass(frozen=True)
class _Shown:
    """A section as HTML, with its anchor and title."""

    key: str
    title: str
    html: Markup


def page(evidence: Evidence, title: str, told: dict[str, str]) -> str:
    """The report as HTML that names nothing outside itself.

    title : str; told : what the user tells of the measurement (operator, instrument ..), by label

    Raises InputError where a result misses what results of its kind hold.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("studies.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    writer = Writer.fresh()
    return environment.get_template("page.html.j2").render(
        title=title,
        told=told,
        sections=[_shown(writer, placed) for placed in sections(evidence, told)],
        styles=[asset(name) for name in _STYLES],
        scripts=[asset(name) for name in _SCRIPTS],
    )


def _shown(writer: Writer, placed: Placed) -> _Shown:
    html = writer.section(placed.section, placed.highlight)
    return _Shown(placed.section.key, placed.section.title, html)
