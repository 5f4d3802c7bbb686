"""The kinds of result, and the class of each. Names cost no import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from calib.errors import CalibError

if TYPE_CHECKING:
    from studies.results.base import Result

_CLASSES = {
    "init": "written.InitResult",
    "design": "design.DesignResult",
    "design_motions": "design.MotionDesignResult",
    "plan": "plan.PlanResult",
    "program": "written.ProgramResult",
    "import": "written.ImportResult",
    "compare": "compare.CompareResult",
    "identify": "identify.IdentifyResult",
    "diagnose": "diagnose.DiagnoseResult",
    "motion": "motion.MotionResult",
    "enough": "enough.EnoughResult",
    "compensate": "compensate.CompensateResult",
    "changes": "changes.ChangesResult",
    "report": "written.ReportResult",
    "demo": "written.DemoResult",
}
"""Kind -> module in ``results``, and its class."""
KINDS = tuple(_CLASSES)
_STATED = {
    "Identification": "identify",
    "Diagnosis": "diagnose",
    "MotionDiagnosis": "motion",
    "Compensation": "compensate",
    "Design": "design",
    "MotionDesign": "design_motions",
    "Enough": "enough",
    "PowerAnalysis": "plan",
}
"""Class of ``calib`` or ``doe`` -> the kind of result that states it."""


def result_type(kind: str) -> type[Result]:
    """The class of a kind."""
    module, name = _CLASSES[kind].split(".")
    found: type[Result] = getattr(import_module(f"studies.results.{module}"), name)
    return found


def kind_of(found: Any) -> str:
    """The kind of result that states an object. Raises CalibError where none does."""
    name = type(found).__name__
    if name not in _STATED:
        raise CalibError(f"found is a {name}; give one of {', '.join(_STATED)}")
    return _STATED[name]
