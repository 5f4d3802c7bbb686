"""Values of the cell file, each with what it must be: plausible numbers, names, directions."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict

from calib.files.read import fault_of_name

_LARGEST = 1e9  # in any unit
SMALLEST = 1e-9


def _plausible(value: float) -> float:
    if abs(value) > _LARGEST:
        raise ValueError("is of no plausible size")
    return value


def _not_vanishing(value: float) -> float:
    if value < SMALLEST:
        raise ValueError("is too small to mean anything")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False), AfterValidator(_plausible)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_vanishing)]
NotNegative = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]
Vector = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number, Number, Number]


def plain(name: str) -> str:
    if fault := fault_of_name(name):
        raise ValueError(f"the name {fault}")
    return name


Name = Annotated[str, AfterValidator(plain)]


def ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"lower limit {limits[0]:g} is above upper limit {limits[1]:g}")
    return limits


def _direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(map(abs, vector)) < SMALLEST:
        raise ValueError("a direction must not be zero")
    return vector


Range = Annotated[tuple[Number, Number], AfterValidator(ordered)]
Direction = Annotated[Vector, AfterValidator(_direction)]


class Table(BaseModel):
    """A TOML table without unknown keys."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)
