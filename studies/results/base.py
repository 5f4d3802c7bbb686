"""What all results share: an object of the JSON, the head of a result, and the errors that it states.

Every class holds the values of its JSON in the units of their names; ``of`` fills it by keywords.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypedDict

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from calib.errors import CalibError
from calib.files.read import sha256

if TYPE_CHECKING:
    from pandas import DataFrame

MM, MICRO = 1e3, 1e6
_UNITS = {"mm": 1e-3, "um": 1e-6, "mrad": 1e-3, "urad": 1e-6, "s": 1.0, "SI": 1.0}


def _defined(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float, Field(allow_inf_nan=False)]
Maybe = Annotated[Number | None, BeforeValidator(_defined)]
"""A number that may be undefined: NaN and infinity turn into None."""
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
MaybePositive = Annotated[Positive | None, BeforeValidator(_defined)]
Three = tuple[Number, Number, Number]
Row = tuple[Maybe, ...]
Count = Annotated[int, Field(ge=0, lt=2**53)]
Unit = Literal["mm", "mrad", "px", "percent"]
Owner = Literal["instrument", "arm", "model", "undecided"]
"""Whose an error from pose to pose is."""


class Entry(BaseModel):
    """An object of the JSON; keys that it does not know are ignored on reading."""

    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)

    @classmethod
    def from_object(cls, source: object, **others: Any) -> Self:
        """An entry of an object in SI: its attributes by the names of the fields, in their units.

        ``left_mm`` is a thousand times ``source.left``, unless the object has ``left_mm``;
        arrays become lists
        others : fields of other names
        """
        values = dict(others)
        for name, field in cls.model_fields.items():
            plain, _, unit = name.rpartition("_")
            if name in others:
                continue
            if unit in _UNITS and not hasattr(source, name) and hasattr(source, plain):
                value = getattr(source, plain)
                values[name] = value if value is None or unit == "SI" else value / _UNITS[unit]
            elif hasattr(source, name) or field.is_required():
                values[name] = getattr(source, name)
            if hasattr(values.get(name), "tolist"):
                values[name] = values[name].tolist()
        return cls(**values)


def named_kind(head: Any) -> str:
    """The kind of a result by its head.

    Its command; ``plan`` of ``diagnose --plan-only``, ``motion`` or ``design_motions`` of motions.
    """
    if getattr(head, "motions", False):
        return "design_motions" if head.command == "design" else "motion"
    return "plan" if getattr(head, "plan_only", False) else str(head.command)


class InputFile(Entry):
    """A file that a result was made from, by its content."""

    file: str
    sha256: str


class Outlier(Entry):
    """A pose that stands out, and why."""

    pose: str
    reason: str


class Cause(Entry):
    """An effect at a place."""

    effect: str
    where: str

    @property
    def key(self) -> str:
        """``effect:where``."""
        return f"{self.effect}:{self.where}"


class DetectionLimit(Cause):
    """The smallest size of a cause that is found nine times in ten, None where no size would be.

    left_mm : what it leaves at the targets if it hides, at the most that such an error plausibly is
    """

    minimum_detectable: Maybe
    unit: str
    left_mm: Maybe = None


class NotAsked(Entry):
    """A cause, ``effect:where``, that the columns of the table cannot speak of, and why."""

    effect: str
    reason: str


class Judgement(NamedTuple):
    """What a tolerance makes of an error; word : for the outcome, where it is not its name."""

    outcome: Literal["pass", "fail", "not decided"]
    by: str
    word: str = ""


class BeforeAfter(NamedTuple):
    """The RMS error that a result begins with, and what it leaves, in a unit.

    of : which error, with {where} for the poses; ends : names of before and after
    heldout : whether at poses that took no part; judged : None without a tolerance
    """

    before: float
    after: float
    of: str
    unit: str = "mm"
    heldout: bool = False
    ends: tuple[str, str] = ("before", "after")
    judged: Judgement | None = None

    @property
    def where(self) -> str:
        """At which poses."""
        return "held-out poses" if self.heldout else "the fitted poses"

    @property
    def name(self) -> str:
        """Which error it is, in words."""
        return self.of.format(where=self.where)


class Result(Entry):
    """The head of every result.

    of_one_cell : whether its inputs begin with a cell
    cell : name of the cell; about : what its [report] says of robot, operator and environment
    """

    of_one_cell: ClassVar[bool] = True
    format: Literal[1] = Field(default=1, alias="schema")
    command: str
    version: str
    seed: int
    inputs: tuple[InputFile, ...]
    cell: str
    about: dict[str, str]
    warnings: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The name of its kind, by which it is read and of its template."""
        return named_kind(self)

    @property
    def error(self) -> BeforeAfter | None:
        """What it begins with and what it leaves; None where it holds no such errors."""
        return None

    @property
    def main_table(self) -> Sequence[Entry]:
        """The rows of its main table."""
        return ()

    def summary(self) -> str:
        """What its command prints, as text."""
        from studies.render import markdown, terminal

        return terminal(markdown(self))

    __repr__ = __str__ = summary

    def _repr_html_(self) -> str:
        from studies.render import html, markdown

        return html(markdown(self))

    def to_frame(self) -> DataFrame:
        """Its main table as a pandas DataFrame. Raises CalibError where pandas is not installed."""
        try:
            from pandas import DataFrame
        except ImportError:
            raise CalibError("to_frame needs pandas: pip install pandas") from None
        return DataFrame([row.model_dump(by_alias=True) for row in self.main_table])

    def to_json(self) -> str:
        """The JSON that :func:`studies.results.read.read` reads."""
        try:
            return self.model_dump_json(by_alias=True, indent=1) + "\n"
        except ValueError:  # a file's name that is no text
            return json.dumps(self.model_dump(by_alias=True), indent=1, allow_nan=False) + "\n"


class Envelope(TypedDict):
    """What a result was made from."""

    version: str
    seed: int
    inputs: tuple[InputFile, ...]
    cell: str
    about: dict[str, str]


def envelope(
    cell: str, inputs: Iterable[Path], seed: int = 0, about: Mapping[str, str] | None = None
) -> Envelope:
    """The head of a result.

    cell, about : name, and what it says of robot and operator; inputs : files, the cell first
    """
    from importlib.metadata import version

    files = tuple(InputFile(file=str(path), sha256=sha256(path)) for path in inputs)
    return Envelope(
        version=version("posecal"), seed=seed, inputs=files, cell=cell, about=dict(about or {})
    )
