"""The sections of a report, in the order of the page: one file each, one entry each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from calib.errors import InputError
from studies.report.evidence import Evidence, Result
from studies.report.parts import Section
from studies.report.sections.approaches import approaches
from studies.report.sections.arm import arm
from studies.report.sections.cell import cell
from studies.report.sections.compensation import compensation
from studies.report.sections.diagnosis import diagnosis, further
from studies.report.sections.errors import errors, workspace
from studies.report.sections.parameters import parameters
from studies.report.sections.plan import plan
from studies.report.sections.progress import progress
from studies.report.sections.sight import sight
from studies.report.sections.summary import summary

OF_THE_CELL: tuple[Callable[[Evidence], Section | None], ...] = (summary, arm, cell)

OF_RESULTS: tuple[tuple[str, Callable[[Evidence, Result], Section | None]], ...] = (
    ("design", plan),
    ("plan", sight),
    ("compare", approaches),
    ("identify", errors),
    ("identify", parameters),
    ("identify", workspace),
    ("diagnose", diagnosis),
    ("diagnose", further),
    ("enough", progress),
    ("compensate", compensation),
)
"""Kind of result, and a section about it."""


FAULTS = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError)
"""What a section raises where a result is not as its command writes it."""


def sections(evidence: Evidence) -> Iterator[Section]:
    """All sections that the evidence allows, but where it comes from.

    Raises InputError that names the result and the section where a result is not complete.
    """
    for about in OF_THE_CELL:
        section = about(evidence)
        if section is not None:
            yield section
    for kind, tell in OF_RESULTS:
        several = evidence.of(kind)
        for number, result in enumerate(several, 1):
            section = _told(evidence, result, tell)
            if section is None:
                continue
            lit = evidence.lit.get(result.path, {})
            section = replace(section, lit=lit)
            if len(several) > 1:
                title = f"{section.title}: {result.path.name}"
                section = replace(section, key=f"{section.key}-{number}", title=title)
            yield section


def _told(
    evidence: Evidence, result: Result, tell: Callable[[Evidence, Result], Section | None]
) -> Section | None:
    try:
        return tell(evidence, result)
    except FAULTS as error:
        what = (
            f"lacks {error}" if isinstance(error, KeyError) else "is not as its command writes it"
        )
        raise InputError(
            result.path, f"for section {tell.__name__}", what, "write it anew with this version"
        ) from None
