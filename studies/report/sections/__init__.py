"""The sections of a report, in the order of the page: what results say, and what they are of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from studies.document import Section
from studies.kinds import KINDS
from studies.report.evidence import Evidence, Result
from studies.report.sections.against import against
from studies.report.sections.arm import arm
from studies.report.sections.cell import cell
from studies.report.sections.certificate import certificate
from studies.report.sections.provenance import provenance
from studies.report.sections.summary import summary

OF_THE_CELL: tuple[Callable[[Evidence], Section | None], ...] = (arm, cell)

WITH_INPUTS: dict[str, tuple[Callable[[Evidence, Result], Section | None], ...]] = {
    "identify": (against,),
}
"""What is told of a record and its inputs, where these are unchanged."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A section on the page.

    highlight : pose -> the name under which the page highlights it
    """

    section: Section
    highlight: Mapping[str, str]


def sections(evidence: Evidence, told: dict[str, str]) -> Iterator[Placed]:
    """All sections that the evidence allows.

    told : what the user tells of the measurement, by label

    """
    yield Placed(summary(evidence, told), {})
    for about in OF_THE_CELL:
        section = about(evidence)
        if section is not None:
            yield Placed(section, {})
    for kind in KINDS:
        several = evidence.of(kind)
        for number, result in enumerate(several, 1):
            highlight = evidence.highlight.get(result.path, {})
            for section in _of(evidence, result):
                own = _own(section, result, number) if len(several) > 1 else section
                yield Placed(own, highlight)
    for section in certificate(evidence, told):
        yield Placed(section, {})
    yield Placed(provenance(evidence, told), {})


def _of(evidence: Evidence, result: Result) -> Iterator[Section]:
    yield from result.told.sections
    told = [tell(evidence, result) for tell in WITH_INPUTS.get(result.kind, ())]
    yield from (section for section in told if section is not None)


def _own(section: Section, result: Result, number: int) -> Section:
    """The section under a name of its own, where several results are of its kind."""
    title = f"{section.title}: {result.path.name}"
    return replace(section, key=f"{section.key}-{number}", title=title)
