"""The kinds of result, and the class of each. Names cost no import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from studies.results.base import Result

_CLASSES = {
    "init": "init.InitResult",
    "design": "design.DesignResult",
    "plan": "plan.PlanResult",
    "program": "program.ProgramResult",
    "import": "import_.ImportResult",
    "compare": "compare.CompareResult",
    "identify": "identify.IdentifyResult",
    "diagnose": "diagnose.DiagnoseResult",
    "enough": "enough.EnoughResult",
    "compensate": "compensate.CompensateResult",
    "changes": "changes.ChangesResult",
    "report": "report.ReportResult",
    "demo": "demo.DemoResult",
}
"""Kind -> module in ``results``, and its class."""
KINDS = tuple(_CLASSES)


def result_type(kind: str) -> type[Result]:
    """The class of a kind."""
    module, name = _CLASSES[kind].split(".")
    return cast("type[Result]", getattr(import_module(f"studies.results.{module}"), name))
