"""Values in the tables of a cell: what each must be, how it becomes SI, and what its key means.

A table of a cell is a dataclass whose fields are in SI, or a model: ``Annotated`` says how its keys are
written, and the line below each field what it means, which ``posecal explain cell`` shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict
from pydantic_core import core_schema

from calib.arrays import Array

MM, URAD, DEG = 1e-3, 1e-6, math.pi / 180.0
"""SI of the units of most keys."""
SMALLEST = 1e-9
_LARGEST = 1e9  # in any unit
_LONGEST_NAME = 100  # characters
_HEAVIEST = 2500.0  # kg: the largest arms on the market carry 2300
STRICT = ConfigDict(extra="forbid")
"""Of a table: it has no unknown keys."""


class TomlTable(BaseModel):
    """A table without unknown keys."""

    model_config = STRICT


def key(name: str) -> Any:
    """The key of a field of another name."""
    return Field(alias=name)


def fault_of_name(name: str) -> str:
    """What is wrong with the name of a marker, joint, pose or station; empty if nothing is."""
    if not name:
        return "is empty"
    if not name.isprintable():
        return "holds a character that cannot be printed"
    if len(name) > _LONGEST_NAME:
        return f"is longer than {_LONGEST_NAME} characters"
    return ""


def plain(name: str) -> str:
    """A name that can be shown. Raises ValueError."""
    if fault := fault_of_name(name):
        raise ValueError(f"the name {fault}")
    return name


def ordered(limits: tuple[float, float]) -> tuple[float, float]:
    """Two limits, the lower one first. Raises ValueError."""
    if limits[0] > limits[1]:
        raise ValueError(f"lower limit {limits[0]:g} is above upper limit {limits[1]:g}")
    return limits


def _plausible(value: float) -> float:
    if abs(value) > _LARGEST:
        raise ValueError("is of no plausible size")
    return value


def _not_vanishing(value: float) -> float:
    if value < SMALLEST:
        raise ValueError("is too small to mean anything")
    return value


def _direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(map(abs, vector)) < SMALLEST:
        raise ValueError("a direction must not be zero")
    return vector


def _mass(kilograms: float) -> float:
    if kilograms > _HEAVIEST:
        grams = f"; if these are grams, write {kilograms / 1e3:g}"
        raise ValueError(f"no arm carries so many kilograms{grams}")
    return kilograms


def times(scale: float) -> Any:
    """Of a number in another unit: SI."""
    return AfterValidator(lambda value: value * scale)


class Written:
    """Of a field in SI: the type of what is written in its place, and what makes the field of it."""

    def __init__(self, kind: Any, made: Callable[[Any], Any]):
        self.kind, self.made = kind, made

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """The schema of what is written, and the field behind it."""
        inner = handler.generate_schema(self.kind)
        return core_schema.no_info_after_validator_function(self.made, inner)


Number = Annotated[float, Strict(), Field(allow_inf_nan=False), AfterValidator(_plausible)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_vanishing)]
NotNegative = Annotated[Number, Field(ge=0)]
Mass = Annotated[NotNegative, AfterValidator(_mass)]
Count = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]
Flag = Annotated[bool, Strict()]
Name = Annotated[str, AfterValidator(plain)]
Vector = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number, Number, Number]
Range = Annotated[tuple[Number, Number], AfterValidator(ordered)]
Direction = Annotated[Vector, AfterValidator(_direction)]
Metres = Annotated[Number, times(MM)]
PositiveMetres = Annotated[Positive, times(MM)]
NotNegativeMetres = Annotated[NotNegative, times(MM)]
"""Written in mm."""
Point = Annotated[Array, Written(Vector, lambda point: np.array(point) * MM)]
"""Shape (3,), m, written in mm."""
Place = Annotated[
    tuple[float, float, float], Written(Vector, lambda point: tuple(x * MM for x in point))
]
"""The same as three numbers."""


def form_of(value: Any) -> str:
    """Whether a key that may hold either holds a table or one plain value."""
    return "table" if isinstance(value, dict) else "plain"
