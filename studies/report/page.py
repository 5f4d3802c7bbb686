"""The page: sections in a frame, styles and scripts within it, so that it needs nothing else."""

from __future__ import annotations

from studies.report.assets import asset
from studies.report.evidence import Evidence
from studies.report.figures import inline_svg
from studies.report.parts import Figure, Raw, Table, Text
from studies.report.sections import sections
from studies.report.sections.provenance import provenance

_STYLES = ("page.css", "lit.css", "arm_view.css")
_SCRIPTS = ("page.js", "arm_view.js")


def page(evidence: Evidence, title: str, told: dict[str, str]) -> str:
    """The report as HTML that names nothing outside itself.

    title : str; told : what the user tells of the measurement (operator, instrument ..), by label

    Raises KeyError, TypeError or ValueError where a result misses what results of its kind hold.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("studies.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["text"] = lambda part: isinstance(part, Text)
    environment.tests["table"] = lambda part: isinstance(part, Table)
    environment.tests["figure"] = lambda part: isinstance(part, Figure)
    environment.tests["raw"] = lambda part: isinstance(part, Raw)
    found = [*sections(evidence), provenance(evidence, told)]
    figures = [
        (section, part) for section in found for part in section.parts if isinstance(part, Figure)
    ]
    drawn = {
        id(figure): inline_svg(figure.picture, f"f{number}", section.lit)
        for number, (section, figure) in enumerate(figures)
    }
    return environment.get_template("page.html.j2").render(
        title=title,
        told=told,
        sections=found,
        drawn=drawn,
        key=id,
        numbers=_numbers,
        styles=[asset(name) for name in _STYLES],
        scripts=[asset(name) for name in _SCRIPTS],
    )


def _numbers(figure: Figure) -> Table | None:
    """The table under a figure."""
    picture = figure.picture
    if not figure.numbers or not picture.rows:
        return None
    return Table(
        picture.header,
        picture.rows,
        of_poses=picture.header[0] == "pose",
        fold=f"The numbers: {len(picture.rows)} row{'s' * (len(picture.rows) > 1)}",
    )
