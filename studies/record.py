"""What every result is: a frozen record in the units of its JSON, one way to write it, one to read it.

What is wrong in a file is told with its place, as one line; what is wrong in this code is a traceback.
"""

from __future__ import annotations

import json
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NotRequired, TypedDict, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
)

from calib.errors import InputError
from calib.files.read import read_text, sha256
from studies.kinds import KINDS, record_type

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from calib.arrays import Array
    from studies.document import Document

_MOST_BYTES = 200_000_000
_LARGEST = 1e30  # in any unit: nothing larger can be drawn
_ANEW = "write it anew with this version"


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


R = TypeVar("R", bound="Record")


class InputFile(Entry):
    """A file that a result was made from, by its content."""

    file: str
    sha256: str


class Record(Entry):
    """A result: what is common to all, and how it is told.

    of_one_cell : whether its inputs begin with a cell
    cell : its name, empty in results of earlier versions
    about : what its [report] tells of robot, operator and environment

    A kind adds its fields, and what must hold between them for :meth:`told` to be sure of it.
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

    @abstractmethod
    def told(self) -> Document:
        """What the terminal and the page say of it."""

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


class _Head(BaseModel):
    """By which a result is known before it is read."""

    format: int = Field(alias="schema")
    command: str
    plan_only: bool = False
    inputs: list[InputFile]

    @property
    def kind(self) -> str:
        return "plan" if self.command == "diagnose" and self.plan_only else self.command


def kind_of(path: Path) -> str:
    """The kind of a result: its command, or ``plan`` for ``diagnose --plan-only``.

    Raises InputError where the file is no result, or of another version of the format.
    """
    head = _head(read_text(path, _MOST_BYTES), path)
    if head.format != 1:
        raise InputError(path, "schema", "is not 1", "write the result anew with this version")
    return head.kind


def read(path: Path) -> Record:
    """The record in a file. Raises InputError naming the file and the place in it."""
    text, kind = read_text(path, _MOST_BYTES), kind_of(path)
    if kind not in KINDS:
        raise InputError(
            path, "command", f"{kind[:40]!r} is no kind of result", f"known are {', '.join(KINDS)}"
        )
    try:
        return record_type(kind).model_validate_json(text)
    except ValidationError as error:
        first, *others = error.errors(include_url=False, include_input=False)
        more = f" (and {len(others)} more)" if others else ""
        raise InputError(path, _place(first), f"{_fault(first)}{more}", _ANEW) from None


def read_as(path: Path, kind: type[R]) -> R:
    """The record in a file that is known to be of a kind. Raises InputError."""
    record = read(path)
    if not isinstance(record, kind):
        raise InputError(path, "command", f"is {record.command}", "name another result")
    return record


def _head(text: str, path: Path) -> _Head:
    try:
        return _Head.model_validate_json(text)
    except ValidationError:
        raise InputError(
            path, "", "is no result of posecal", "write one with --json of a command"
        ) from None


def _place(error: ErrorDetails) -> str:
    """``rms_mm.heldout``, ``targets[3].left_mm``: where in the file, empty for the whole."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in error["loc"])
    return "".join(parts).removeprefix(".")


def _fault(error: ErrorDetails) -> str:
    known = {"missing": "is missing", "extra_forbidden": "is not known"}
    message = error["msg"].removeprefix("Input ").removeprefix("Value error, ")
    return known.get(error["type"], message[:1].lower() + message[1:])


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of result, as it is written."""
    return record_type(kind).model_json_schema(mode="serialization")
