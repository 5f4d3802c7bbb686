"""What tests of a comparison share."""

from __future__ import annotations

from typing import Any

from studies.compare.compare import PlanComparison
from studies.compare.record import compare_record
from tests.helpers import MADE_FROM


def fields_of(result: PlanComparison) -> dict[str, Any]:
    """What ``compare --json`` says of a result, without provenance."""
    return compare_record(result, MADE_FROM).model_dump()
