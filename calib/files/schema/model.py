"""``[model]``, ``[diagnosis]``, ``[acceptance]``: what is identified, sought, and good enough."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from calib.files.schema.values import Number, Positive, Table


class DiagnosisTable(Table):
    exclude: list[str] = []


class PriorTable(Table):
    file: Annotated[str, Field(min_length=1)]


class AcceptanceTable(Table):
    tolerance_mm: Positive
    rule: Literal["simple", "guarded"] = "guarded"


def _widths(value: object) -> object:
    """What stands for widths, or the one line that says what would."""
    numbers = value.values() if isinstance(value, dict) else ()
    right = all(type(n) in (int, float) and 0.0 < n < math.inf for n in numbers)
    if value in ("estimated", "off") or (isinstance(value, dict) and numbers and right):
        return value
    raise ValueError(
        'must be "estimated", "off", or widths above zero, as { geometry_mrad = 10, geometry_mm = 3 }'
    )


class ModelTable(Table):
    effects: Annotated[list[str], Field(min_length=1)]
    knots_deg: dict[str, list[Number]] = {}
    prior: PriorTable | None = None
    size_prior: Annotated[
        Literal["estimated", "off"] | dict[str, Positive], BeforeValidator(_widths)
    ] = "estimated"
