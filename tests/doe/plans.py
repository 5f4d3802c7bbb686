"""Plans that take little time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import doe
from calib import Cell, Poses
from doe.planning import planned
from doe.request import request_of


def unpolished(cell: Cell, against: Mapping[str, Poses] | None = None, **asked: Any) -> doe.Design:
    """The plan of candidates alone."""
    return planned(cell, replace(request_of(cell, **asked), polish=False), against or {})


def visiting_again(cell: Cell, count: int) -> Cell:
    """The cell whose plans visit so many poses again."""
    return replace(cell, design=replace(cell.design, reapproaches=count))
