"""What every result is: a frozen record in the units of its JSON, one way to write it, one to read it.

:meth:`Entry.from_result` fills a record from the objects of ``calib`` and ``doe``, which are in SI.
What is wrong in a file is told with its place, as one line; what is wrong in this code is a traceback.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    TypedDict,
    get_args,
    get_origin,
)

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from calib.files.read import sha256
from studies.document import Shown


def _defined(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float, Field(allow_inf_nan=False)]
"""A figure that every result has."""
Maybe = Annotated[Number | None, BeforeValidator(_defined)]
"""A figure that may be undefined: None, into which NaN and infinity turn."""
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
MaybePositive = Annotated[Positive | None, BeforeValidator(_defined)]
Three = tuple[Number, Number, Number]
"""A vector in space."""
Count = Annotated[int, Field(ge=0, lt=2**53)]
Owner = Literal["instrument", "arm", "model", "undecided"]
"""Whose an error from pose to pose is."""


_HOUR = 3600.0
_PER_UNIT = {
    "nm": 1e9,
    "um": 1e6,
    "mm": 1e3,
    "urad": 1e6,
    "mrad": 1e3,
    "rad": 1.0,
    "deg": math.degrees(1.0),
    "mm_per_n": 1e3,
    "um_per_h": 1e6 * _HOUR,
    "urad_per_h": 1e6 * _HOUR,
    "1_turn": 1.0,
    "px": 1.0,
    "percent": 100.0,
    "s": 1.0,
    "h": 1.0 / _HOUR,
    "hours": 1.0 / _HOUR,
    "si": 1.0,
}
"""Suffix of a field -> how many of its unit make one SI unit."""


@dataclass(frozen=True)
class From:
    """Where a field comes from, in its annotation, as far as its name does not say it.

    path : names of attributes, keys and places with dots between them; else the field's name, with or
        without its unit
    own_unit : whether a result names the unit: it has a ``scale``, the size of one unit in SI
    """

    path: str = ""
    own_unit: bool = False


OWN_UNIT = From(own_unit=True)
"""Of a value in SI whose unit the result names."""


class Entry(BaseModel):
    """A part of a record: the names and types of its JSON; others are ignored on reading."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, populate_by_name=True)

    @classmethod
    def from_result(cls, *results: object, **own: Any) -> Self:
        """An entry filled from results by the names of its fields.

        results : objects or mappings in SI; of several, the first that has an attribute gives it
        own : fields that are neither a copy nor a scaling, in the units of the entry

        A field takes the attribute of its name, or the one that :class:`From` in its annotation says.
        One whose name ends in a unit takes the attribute of the name without it, times the unit:
        ``rms_mm`` is 1e3 ``rms``, and ``drift_um_per_h`` 3.6e9 ``drift``. Values take the shape of the
        field's type: arrays become tuples, and paths texts; a count is the number of what is listed;
        an object that stands where an entry does is filled in the same way, also within tuples and
        dicts; None stays None, and NaN becomes None where the field may be undefined.

        >>> from types import SimpleNamespace
        >>> class Error(Entry):
        ...     name: str
        ...     rms_mm: Maybe
        ...     at_mm: Three
        ...     parts: tuple[InputFile, ...]
        >>> part = SimpleNamespace(file="a.csv", sha256="0f")
        >>> found = SimpleNamespace(rms=math.nan, at=np.array([0.0, 0.5, 1.0]), parts=[part])
        >>> Error.from_result(found, name="tip").model_dump()["at_mm"]
        (0.0, 500.0, 1000.0)

        Raises TypeError where no result has what a field needs, or no field takes what is given.
        """
        if strange := own.keys() - cls.model_fields:
            raise TypeError(f"{cls.__name__} has no {', '.join(sorted(strange))}")
        values, missing = {}, []
        for name, field in cls.model_fields.items():
            given = own.pop(name) if name in own else _found(results, name, field.metadata)
            if given is not _ABSENT:
                values[name] = _shaped(given, field.annotation)
            elif field.is_required() or get_origin(field.annotation) is not Literal:
                missing.append(name)
        if missing:
            raise TypeError(f"no result tells {cls.__name__} of {', '.join(missing)}")
        return cls(**values)

    @classmethod
    def from_each(cls, each: Iterable[object], **columns: Iterable[Any]) -> tuple[Self, ...]:
        """An entry for each of several results, as :meth:`from_result` fills it.

        columns : what else is known, under the name of a field or what it comes from, one for each, SI

        >>> from types import SimpleNamespace
        >>> class Known(Entry):
        ...     name: str
        ...     std: Annotated[Maybe, OWN_UNIT]
        >>> angle = SimpleNamespace(name="rz", scale=1e-6, unit="urad")
        >>> Known.from_each([angle], std=np.array([2e-6]))
        (Known(name='rz', std=2.0),)
        """
        found = zip(each, *columns.values(), strict=True)
        return tuple(
            cls.from_result(dict(zip(columns, own, strict=True)), one) for one, *own in found
        )


_ABSENT = object()


def _found(results: Sequence[object], name: str, told: Iterable[object]) -> Any:
    """What a field takes from results, in its unit; told : of its annotation."""
    source = next((own for own in told if isinstance(own, From)), From())
    for path, factor in _sources(name, source):
        found = _attribute(results, path)
        if found is not _ABSENT:
            per = _attribute(results, "scale") if source.own_unit else 1.0
            return found if factor == per == 1.0 else _scaled(found, factor, per)
    return _ABSENT


def _sources(name: str, source: From) -> Iterator[tuple[str, float]]:
    """Where a field may come from, and how many of its unit make one SI unit there."""
    units = [unit for unit in _PER_UNIT if f"_{name}".endswith(f"_{unit}")]
    factors = [1.0 if source.own_unit else _PER_UNIT[unit] for unit in units]
    if source.path:
        yield source.path, factors[0] if units else 1.0
        return
    yield name, 1.0
    for unit, factor in zip(units, factors, strict=True):
        yield name.removesuffix(f"_{unit}"), factor


def _attribute(results: Iterable[object], path: str) -> Any:
    """The first that a result has at a path; None behind what is None."""
    for result in results:
        found: Any = result
        for name in path.split("."):
            if isinstance(found, Mapping):
                found = found.get(name, _ABSENT)
            elif isinstance(found, tuple | np.ndarray) and name.isdigit():
                found = found[int(name)]
            elif found is not None:
                found = getattr(found, name, _ABSENT)
        if found is not _ABSENT and not callable(found):
            return found
    return _ABSENT


def _scaled(value: Any, factor: float, per: float) -> Any:
    if value is None:
        return None
    if isinstance(value, Mapping):
        return {key: _scaled(own, factor, per) for key, own in value.items()}
    if isinstance(value, list | tuple):
        made = [_scaled(own, factor, per) for own in value]
        return type(value)(*made) if hasattr(value, "_fields") else tuple(made)
    return value * factor / per


def _shaped(value: Any, kind: Any) -> Any:
    """A value in the shape of a field's type."""
    if value is None or isinstance(value, str | BaseModel):
        return value
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if kind is int and isinstance(value, Sized):
        return len(value)
    if kind is str and isinstance(value, Path):
        return str(value)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _shaped(value, inner[0])
    if origin is tuple and isinstance(value, Iterable):
        rows = tuple(value)
        kinds = inner[:1] * len(rows) if inner[-1] is Ellipsis else inner
        return tuple(map(_shaped, rows, kinds)) if len(kinds) == len(rows) else rows
    if origin is dict and isinstance(value, Mapping):
        return {key: _shaped(own, inner[1]) for key, own in value.items()}
    if isinstance(kind, type) and issubclass(kind, Entry) and not isinstance(value, Mapping):
        return kind.from_result(value)
    others = [own for own in inner if own is not type(None)]
    if len(others) == 1 < len(inner):
        return _shaped(value, others[0])
    return tuple(_shaped(own, Any) for own in value) if isinstance(value, list) else value


class IntervalEntry(Entry):
    """A value with its 95 % interval, in the unit of its field; None where that is open."""

    value: Number
    low: Maybe
    high: Maybe


class InputFile(Entry):
    """A file that a result was made from, by its content."""

    file: str
    sha256: str


class Outlier(Entry):
    """A pose that stands out, and why."""

    pose: Annotated[str, Shown("left out")]
    reason: Annotated[str, Shown("because")]


class UnidentifiableEntry(Entry):
    """Parameters that the poses do not determine."""

    names: tuple[str, ...]
    reason: str


class Judgement(NamedTuple):
    """What a tolerance makes of an error; word : for the outcome, where it is not its name."""

    outcome: Literal["pass", "fail"]
    by: str
    word: str = ""


class BeforeAfter(NamedTuple):
    """The RMS error that a result begins with, and what it leaves, in a unit.

    of : which error, with {where} for the poses; ends : what before and after are called
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


class Record(Entry):
    """A result: what is common to all.

    of_one_cell : whether its inputs begin with a cell
    cell : its name; about : what its [report] tells of robot, operator and environment
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
        """The name of its kind, by which it is read."""
        return self.command

    @property
    def error(self) -> BeforeAfter | None:
        """What it begins with and what it leaves; None where it holds no such errors."""
        return None

    def dumps(self) -> str:
        """The JSON that :func:`read` reads."""
        return json.dumps(self.model_dump(by_alias=True), indent=1, allow_nan=False) + "\n"


class Envelope(TypedDict):
    """What a result was made from."""

    version: str
    seed: int
    inputs: tuple[InputFile, ...]
    cell: str
    about: dict[str, str]


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
