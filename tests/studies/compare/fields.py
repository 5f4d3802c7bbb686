"""What tests of a comparison share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from calib import Cell
from studies.compare.compare import PlanComparison
from studies.compare.make import compare_record
from tests.helpers import MADE_FROM


def fields_of(result: PlanComparison) -> dict[str, Any]:
    """What ``compare --json`` says of a result, without provenance."""
    return compare_record(result, MADE_FROM).model_dump()


def one_marker(cell: Cell) -> Cell:
    """The cell with its first marker alone."""
    return replace(
        cell,
        marker_names=("m1",),
        markers=cell.markers[:1],
        marker_normals=cell.marker_normals[:1],
        marker_acceptance=cell.marker_acceptance[:1],
    )
