"""What a result says, once: sections of sentences, tables and figures, which two renderers show.

``terminal`` shows the short form, ``page`` all of it, as HTML. Neither knows any kind of result. Parts
hold values and rules, no markup; every rule of rounding that a result is told by stands here, once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar, get_args, get_origin

if TYPE_CHECKING:
    from markupsafe import Markup
    from pydantic import BaseModel

    from studies.plots.style import Picture

_MOST_NAMES = 8
_MOST_DIGITS = 12
LINE = 100
"""Letters of a line of sentences."""


@dataclass(frozen=True)
class Rule:
    """A value as text.

    show : value -> text; absent : what stands for None; number : whether columns of it stand right
    """

    show: Callable[[Any], str]
    absent: str = "-"
    number: bool = True

    def __call__(self, value: Any) -> str:
        """The value by the rule.

        >>> MM(0.01234), MM(None), FOUR(1234.56), STD(0.082812), PERCENT(0.1234), PROBABILITY(1e-5)
        ('0.0123', '-', '1235', '0.0828', '12.3', '< 0.01')
        """
        return self.absent if value is None else self.show(value)


def fixed(digits: int) -> Rule:
    """So many digits after the point."""
    return Rule(lambda value: f"{value:.{digits}f}")


def listed(names: Sequence[str], most: int = _MOST_NAMES) -> str:
    """Names with commas, the first few of many.

    >>> listed(["a", "b"]), listed(list("abcdefghij"), 3)
    ('a, b', 'a, b, c and 7 more')
    """
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"


def fitting(forms: Iterable[str], width: int = LINE) -> str:
    """The first form that a line holds, else the last.

    >>> fitting(["a sentence", "short"], 5), fitting(["never", "fits"], 3)
    ('short', 'fits')
    """
    form = ""
    for form in forms:
        if len(form) <= width:
            break
    return form


def to_std(*values: float | None) -> str:
    """Values to two digits of the standard deviation, which stands last, joined by "to".

    >>> to_std(1.23456, 0.0123), to_std(1.2, 3.4, 0.5), to_std(1234.5678, None)
    ('1.235', '1.20 to 3.40', '1234.568')
    """
    *shown, std = values
    digits = 1 - math.floor(math.log10(std)) if std and std > 0.0 else 3
    return " to ".join(f"{value:.{min(max(digits, 0), _MOST_DIGITS)}f}" for value in shown)


TEXT = Rule(str, absent="", number=False)
COUNT = Rule(lambda value: f"{value:d}" if value else "", absent="")
NAMES = Rule(lambda names: listed(names, 2), absent="", number=False)
MM = fixed(4)
MRAD = fixed(3)
JOINT = fixed(4)
HUNDREDTH = fixed(2)
FOUR = Rule(lambda value: f"{value:.4g}")
PROVED = Rule(lambda share: f"{math.floor(share * 1e4) / 1e2:.2f} %")
"""Never rounded up."""
PERCENT = Rule(lambda share: f"{100.0 * share:.1f}")
SHARE = Rule(lambda share: f"{100.0 * share:.0f} %")
PROBABILITY = Rule(lambda value: f"{value:.2f}" if value >= 0.005 else "< 0.01")
STD = Rule(lambda value: f"{value:.3g}", absent="open")
TO_STD = Rule(lambda values: to_std(*values), absent="not estimated")
TENTH = fixed(1)
TWO = Rule(lambda value: f"{float(f'{value:.1e}'):g}")
HOURS = fixed(2)
WHOLE = fixed(0)
P = Rule(lambda value: f"{value:.2g}")
CORRELATION = Rule(lambda value: f"{value:+.3f}")
THREE = Rule(lambda values: " ".join(f"{value:6.1f}" for value in values))


def mm(value: float | None) -> str:
    """A length in a sentence.

    >>> mm(0.01234), mm(None)
    ('0.0123 mm', 'open')
    """
    return "open" if value is None else f"{MM(value)} mm"


def plural(count: int, what: str) -> str:
    """A number of things.

    >>> plural(1, "pose"), plural(3, "pose")
    ('1 pose', '3 poses')
    """
    return f"{count} {what}{'s' * (count != 1)}"


# -- parts -----------------------------------------------------------------------------------

R = TypeVar("R", contravariant=True)
S = TypeVar("S")
E = TypeVar("E", bound="BaseModel")

Mood: TypeAlias = Literal["", "good", "warn", "note", "next"]
"""How a sentence is meant; the page sets all but plain ones in a box."""


@dataclass(frozen=True)
class Sentence:
    """Words. One without a label that follows one with a label belongs to it.

    label : what it is about, in a word or two
    """

    text: str
    mood: Mood = ""
    label: str = ""


def labelled(label: str, texts: Iterable[str]) -> Iterator[Sentence]:
    """What is said of one thing, the label once."""
    for number, text in enumerate(texts):
        yield Sentence(text, label="" if number else label)


@dataclass(frozen=True)
class Column(Generic[R]):
    """A column: its title and unit, what of a row stands in it, and by which rule it is rounded."""

    title: str
    of: Callable[[R], Any]
    rule: Rule = TEXT
    unit: str = ""
    detail: bool = False
    """For the page only."""

    def cell(self, row: R) -> str:
        """What stands in it."""
        return self.rule(self.of(row))


@dataclass(frozen=True)
class Shown:
    """How a field of a record stands in tables, in its annotation, as far as its name does not say it.

    title : else the field's name without its unit; rule : else by name, unit and type
    unit : else the one that the name ends in; detail : for the page only
    """

    title: str = ""
    rule: Rule | None = None
    unit: str = ""
    detail: bool = False


_BY_UNIT = {"mm": MM, "mrad": MRAD}
_BY_NAME = {"std": STD, "p": P, "probability": PROBABILITY, "share": SHARE, "value": FOUR}
_TITLES = {"id": "parameter", "key": "cause"}


def columns(kind: type[E], *of: str | Column[E]) -> tuple[Column[E], ...]:
    """Columns of entries: those of named fields, as the fields themselves say, and others as given.

    of : names of fields and properties with blanks between them, ``outer_mm.inner`` too; or columns

    >>> from typing import Annotated
    >>> from pydantic import create_model
    >>> turned = Annotated[float, Shown("turned", MRAD, "mrad")]
    >>> Reach = create_model("Reach", pose=(str, ...), left_mm=(float, ...), turn=(turned, ...))
    >>> [(c.title, c.unit, c.cell(Reach(pose="p1", left_mm=0.5, turn=2.0)))
    ...  for c in columns(Reach, "pose left_mm turn")]
    [('pose', '', 'p1'), ('left', 'mm', '0.5000'), ('turned', 'mrad', '2.000')]
    """
    parts = ([own] if isinstance(own, Column) else _named(kind, own) for own in of)
    return tuple(column for part in parts for column in part)


def heads(*heads: str | Shown) -> tuple[Column[Any], ...]:
    """Columns of rows that are tuples, by their places; a head is a title, ``RMS [mm]``.

    >>> [(c.title, c.unit, c.cell(("p1", 0.5))) for c in heads("pose", "RMS [mm]")]
    [('pose', '', 'p1'), ('RMS', 'mm', '0.5000')]
    """
    found = []
    for place, head in enumerate(heads):
        title, _, unit = head.rstrip("]").partition(" [") if isinstance(head, str) else ("", "", "")
        own = Shown(title, unit=unit) if isinstance(head, str) else head
        rule = own.rule or _BY_UNIT.get(own.unit, TEXT)
        found.append(Column(own.title, itemgetter(place), rule, own.unit, own.detail))
    return tuple(found)


def _named(kind: type[E], names: str) -> Iterator[Column[E]]:
    for path in names.split():
        *outer, name = path.split(".")
        inner: Any = kind
        for own in outer:
            inner = inner.model_fields[own].annotation
        field = inner.model_fields.get(name)
        told = () if field is None else field.metadata
        shown = next((own for own in told if isinstance(own, Shown)), Shown())
        unit = next((unit for unit in _BY_UNIT if name.endswith(f"_{unit}")), "")
        plain = name.removesuffix(f"_{unit}").replace("_", " ")
        rule = shown.rule or _BY_UNIT.get(unit) or _BY_NAME.get(name)
        rule = rule or (TEXT if field is None else _by_type(field.annotation))
        title = shown.title or _TITLES.get(name, plain)
        yield Column(title, attrgetter(path), rule, shown.unit or unit, shown.detail)


def _by_type(kind: Any) -> Rule:
    """Names, a count or a figure; what may be None by what else it is."""
    own = [one for one in get_args(kind) if one is not type(None)]
    if get_origin(kind) is Literal or kind is str:
        return TEXT
    if get_origin(kind) is tuple:
        return NAMES
    return COUNT if kind is int else _by_type(own[0]) if own else FOUR


@dataclass(frozen=True)
class Table(Generic[S]):
    """Rows by columns.

    name : what it is called where it is folded, and for those who do not see it
    most : rows that the terminal shows of many, None for all
    fold : whether the page folds it; None for where it is long
    paper : whether it is printed even where it is folded
    """

    columns: Sequence[Column[S]]
    rows: Sequence[S]
    name: str = ""
    caption: str = ""
    most: int | None = None
    fold: bool | None = None
    paper: bool = False


@dataclass(frozen=True)
class Figure:
    """A picture, drawn when it is wanted: on the page, and for --figures."""

    draw: Callable[[], Picture]


@dataclass(frozen=True)
class Detail:
    """Parts for the page only, folded under a title where they have one."""

    parts: tuple[Part, ...]
    title: str = ""


@dataclass(frozen=True)
class Lines:
    """Lines that stand as they are: commands, code, what a program printed."""

    text: str


@dataclass(frozen=True)
class Raw:
    """Markup made by the page itself."""

    html: Markup


Part: TypeAlias = Sentence | Table[Any] | Figure | Detail | Lines | Raw


@dataclass(frozen=True)
class Section:
    """A section; key is its anchor."""

    key: str
    title: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Document:
    """All that a result says.

    headline : the answer: what the terminal says first, and the first screen of a page of its results
    """

    headline: tuple[Sentence, ...]
    sections: tuple[Section, ...]


def pictures_of(document: Document) -> Iterator[Picture]:
    """Every figure, drawn."""
    for section in document.sections:
        yield from _drawn(section.parts)


def _drawn(parts: Sequence[Part]) -> Iterator[Picture]:
    for part in parts:
        if isinstance(part, Figure):
            yield part.draw()
        elif isinstance(part, Detail):
            yield from _drawn(part.parts)
