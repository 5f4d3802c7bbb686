"""The kinds of result, and the class of each. Names cost no import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from studies.document import Document

_CLASSES = {
    "init": "results.init:InitResult",
    "design": "results.design:DesignResult",
    "plan": "results.plan:PlanResult",
    "program": "results.program:ProgramResult",
    "import": "results.import_:ImportResult",
    "compare": "results.compare:CompareResult",
    "identify": "identify.record:IdentifyRecord",
    "diagnose": "diagnose.record:DiagnoseRecord",
    "enough": "results.enough:EnoughResult",
    "compensate": "results.compensate:CompensateResult",
    "changes": "changes.record:ChangesRecord",
    "report": "report.page:ReportRecord",
    "demo": "results.demo:DemoResult",
}
KINDS = tuple(_CLASSES)
"""In the order in which a page shows them."""


def record_type(kind: str) -> type[Any]:
    """The class of a kind."""
    module, name = _CLASSES[kind].split(":")
    return cast("type[Any]", getattr(import_module(f"studies.{module}"), name))


_TELLINGS = {"identify": "identify.telling", "diagnose": "diagnose.telling",
             "changes": "changes.record", "report": "report.page"}  # fmt: skip


def tell(record: Any) -> Document:
    """What the page says of a result: of one with a template, its Markdown."""
    if record.kind in _TELLINGS:
        module = import_module(f"studies.{_TELLINGS[record.kind]}")
        return cast("Document", module.told(record))
    import re

    from studies.document import Document, Raw, Section, Sentence
    from studies.render import html, markdown

    text = markdown(record, page=True)
    first = re.sub(r"\*\*|\\", "", text.partition("\n\n")[0]).partition(": ")[2]
    title = f"Result of {record.kind}"
    return Document((Sentence(first),), (Section(record.kind, title, (Raw(html(text)),)),))
