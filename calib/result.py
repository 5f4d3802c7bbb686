"""What a result says of itself in an interpreter: a summary, a table, a data frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields
from html import escape
from typing import TYPE_CHECKING, Any

from calib.errors import CalibError

if TYPE_CHECKING:
    from pandas import DataFrame

_MOST_ROWS = 12  # of a table in a summary that is asked for by repr


class Result(ABC):
    """A result that prints as a few sentences and a table.

    A dataclass that is one says ``repr=False``, so that this ``repr`` is used.
    """

    @abstractmethod
    def sentences(self) -> list[str]:
        """What was found, in a line each."""

    @abstractmethod
    def rows(self) -> list[dict[str, object]]:
        """The table of the result: the cells of each row by their column, in the units people read."""

    def summary(self) -> str:
        """The sentences and the whole table."""
        return "\n".join([*self.sentences(), *_lines(self.rows())])

    def to_frame(self) -> DataFrame:
        """The table as a pandas DataFrame. Raises CalibError where pandas is not installed."""
        try:
            from pandas import DataFrame
        except ImportError:
            raise CalibError("to_frame needs pandas: pip install pandas; rows() does not") from None
        return DataFrame(self.rows())

    def __repr__(self) -> str:
        rows = self.rows()
        more = [f"and {len(rows) - _MOST_ROWS} rows more: summary()"] if rows[_MOST_ROWS:] else []
        return "\n".join([*self.sentences(), *_lines(rows[:_MOST_ROWS]), *more])

    def _repr_html_(self) -> str:
        rows = self.rows()
        said = "".join(f"<p>{escape(sentence)}</p>" for sentence in self.sentences())
        if not rows:
            return said
        head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(_text(cell))}</td>" for cell in row.values()) + "</tr>"
            for row in rows
        )
        return f"{said}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def fields_of(found: Any) -> dict[str, Any]:
    """Fields of a dataclass as they are: what a result that goes on from another begins with."""
    return {field.name: getattr(found, field.name) for field in fields(found)}


def _lines(rows: list[dict[str, object]]) -> list[str]:
    """A table in columns: words to the left, numbers to the right."""
    if not rows:
        return []
    table = [list(rows[0]), *([_text(cell) for cell in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    number = [isinstance(cell, int | float) for cell in rows[0].values()]
    return [
        "  ".join(
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, number, strict=True)
        ).rstrip()
        for row in table
    ]


def _text(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
