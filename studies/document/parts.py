"""What a result is told in. Parts hold values and rules, no markup: how they look is the renderers'."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

from studies.document.rules import TEXT, Rule

if TYPE_CHECKING:
    from markupsafe import Markup

    from studies.plots.style import Picture

R = TypeVar("R", contravariant=True)
S = TypeVar("S")

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


def labelled(label: str, texts: Iterable[str], mood: Mood = "") -> Iterator[Sentence]:
    """What is said of one thing, the label once."""
    for number, text in enumerate(texts):
        yield Sentence(text, mood, "" if number else label)


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
class Table(Generic[S]):
    """Rows by columns.

    name : what it is called where it is folded, and for those who do not see it
    of_poses : whether the first column names poses of the data or the plan
    most : rows that the terminal shows of many, None for all
    fold : whether the page folds it; None for where it is long
    paper : whether it is printed even where it is folded
    """

    columns: Sequence[Column[S]]
    rows: Sequence[S]
    name: str = ""
    caption: str = ""
    of_poses: bool = False
    most: int | None = None
    fold: bool | None = None
    paper: bool = False


@dataclass(frozen=True)
class Figure:
    """A picture, drawn when it is wanted: on the page, and for --figures.

    numbers : whether its numbers stand folded below it
    highlight : whether the page highlights its poses; plans side by side call theirs alike
    """

    draw: Callable[[], Picture]
    numbers: bool = True
    highlight: bool = True


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
