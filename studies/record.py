"""What every result is: a frozen record in the units of its JSON, one way to write it, one to read it.

What is wrong in a file is told with its place, as one line; what is wrong in this code is a traceback.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NotRequired, TypedDict

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
)

from calib.files.read import sha256

if TYPE_CHECKING:
    from calib.arrays import Array

_LARGEST = 1e30  # in any unit: nothing larger can be drawn


def _sized(value: float) -> float:
    if not abs(value) < _LARGEST:
        raise ValueError("is of no plausible size")
    return value


def _defined(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_sized)]
"""A figure that every result has."""
Maybe = Annotated[Number | None, BeforeValidator(_defined)]
"""A figure that may be undefined: None, into which NaN and infinity turn."""
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
MaybePositive = Annotated[Positive | None, BeforeValidator(_defined)]
Three = tuple[Number, Number, Number]
"""A vector in space."""
Count = Annotated[int, Field(ge=0, lt=2**53)]


def three(values: Array) -> tuple[float, float, float]:
    """A vector of an array, shape (3,)."""
    x, y, z = values.tolist()
    return x, y, z


class Entry(BaseModel):
    """A part of a record: the names and types of its JSON, no others."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, populate_by_name=True)


class InputFile(Entry):
    """A file that a result was made from, by its content."""

    file: str
    sha256: str


class Record(Entry):
    """A result: what is common to all.

    of_one_cell : whether its inputs begin with a cell
    cell : its name, empty in results of earlier versions
    about : what its [report] tells of robot, operator and environment

    A kind adds its fields, and what must hold between them for its telling to be sure of it.
    """

    of_one_cell: ClassVar[bool] = True
    format: Literal[1] = Field(default=1, alias="schema")
    command: str
    version: str
    seed: int
    inputs: tuple[InputFile, ...]
    cell: str = ""
    about: dict[str, str] = Field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The name of its kind, by which it is read."""
        return self.command

    def dumps(self) -> str:
        """The JSON that :func:`read` reads."""
        return json.dumps(self.model_dump(by_alias=True), indent=1, allow_nan=False) + "\n"


class Envelope(TypedDict):
    """What a result was made from."""

    version: str
    seed: int
    inputs: tuple[InputFile, ...]
    cell: str
    about: NotRequired[dict[str, str]]


def envelope(
    cell: str, inputs: Sequence[Path], seed: int = 0, about: Mapping[str, str] | None = None
) -> Envelope:
    """What every record begins with.

    cell, about : its name, and what it tells of robot and operator; inputs : files, the cell first
    """
    from importlib.metadata import version

    files = tuple(InputFile(file=str(path), sha256=sha256(path)) for path in inputs)
    told = dict(about or {})
    return Envelope(version=version("posecal"), seed=seed, inputs=files, cell=cell, about=told)
