"""What tests of a comparison share."""

from __future__ import annotations

from typing import Any

from studies.compare.compare import Comparison
from studies.compare.record import compare_record
from studies.record import Envelope


def fields_of(result: Comparison) -> dict[str, Any]:
    """What ``compare --json`` says of a result, without provenance."""
    made_from = Envelope(version="0", seed=0, inputs=(), cell="")
    return compare_record(result, made_from).model_dump()
