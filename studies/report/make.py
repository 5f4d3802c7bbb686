"""From result files to the page: what ``posecal report`` does between its options and its output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from studies.report.evidence import load_evidence
from studies.report.page import page


def report_page(
    results: Sequence[Path], title: str | None, told: dict[str, str]
) -> tuple[str, tuple[str, ...]]:
    """The page as HTML, and notes on what had to be left out.

    title : str, None for the name of the cell; told : as in :func:`studies.report.page.page`

    Raises InputError where a file is no result, or one that misses what results of its kind hold.
    """
    evidence = load_evidence(results)
    heading = title or ("Calibration" if evidence.cell is None else evidence.cell.name)
    return page(evidence, heading, told), evidence.notes
