"""``[model]``, ``[diagnosis]``, ``[acceptance]``: what is identified, sought, and good enough."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from calib.files.schema.values import Number, Positive, Table


class DiagnosisTable(Table):
    exclude: list[str] = []


class PriorTable(Table):
    file: Annotated[str, Field(min_length=1)]


class AcceptanceTable(Table):
    tolerance_mm: Positive
    rule: Literal["simple", "guarded"] = "guarded"


class ModelTable(Table):
    effects: Annotated[list[str], Field(min_length=1)]
    knots_deg: dict[str, list[Number]] = {}
    prior: PriorTable | None = None
    size_prior: Literal["estimated", "off"] | dict[str, Positive] = "estimated"
