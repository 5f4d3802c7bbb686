"""``posecal report``: one page that can be handed to a colleague."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command import options
from studies.command.call import Call, working


@click.command()
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=options.PATH)
@options.value("-o --output page_path", "FILE", "Write the page to this file.",
       default=Path("report.html"), show_default=True)  # fmt: skip
@click.option("--title", metavar="TEXT", help="Title. Default: the name of the cell.")
@click.option("--instrument", metavar="TEXT", help="Model, serial number, certificate.")
@click.option("--operator", metavar="TEXT", help="Who measured.")
@click.option("--date", "measured", metavar="TEXT", help="When it was measured.")
@options.result(figures=False, seed=False)
def report(
    call: Call, results: tuple[Path, ...], page_path: Path, title: str | None, **about: str | None
) -> None:
    """Write one self-contained HTML page from results.

    RESULT are files that --json wrote, in any number: of design, compare, identify, diagnose
    (--plan-only too), enough, compensate, changes. Their input files are read again if they
    did not change.

    \b
    Example:
      posecal report identified.json -o report.html --operator "A. Klimchik"
    """
    from studies.report import Reported, page_of
    from studies.results.written import ReportResult

    call.check(results, page_path)
    with working("writing the page"):
        facts = {label: text for label, text in about.items() if text}
        page = page_of([Reported.read(path) for path in results], title, facts)
    result = ReportResult(**call.envelope("", results), page=str(page_path), notes=page.notes)
    call.deliver(result, {page_path: page.html})
