"""What people do to files: each function gives an edit of a text."""

from __future__ import annotations

import re
from collections.abc import Callable

Edit = Callable[[str], str]


def whole(text: str) -> Edit:
    """Something else altogether."""
    return lambda _: text


def swap(old: str, new: str) -> Edit:
    """The first of some words replaced."""

    def edit(text: str) -> str:
        assert old in text, old
        return text.replace(old, new, 1)

    return edit


def added(more: str) -> Edit:
    """Words at the end."""
    return lambda text: text + more


def effects(*names: str) -> Edit:
    """Another list of effects in the model."""
    listed = ", ".join(f'"{name}"' for name in names)
    return lambda text: re.sub(r"effects = \[.*\]", f"effects = [{listed}]", text)


def header(old: str, new: str) -> Edit:
    """A column renamed."""

    def edit(text: str) -> str:
        first, rest = text.split("\n", 1)
        assert old in first, old
        return first.replace(old, new, 1) + "\n" + rest

    return edit


def line(number: int, change: Edit) -> Edit:
    """One line changed, the first is 1."""

    def edit(text: str) -> str:
        lines = text.split("\n")
        lines[number - 1] = change(lines[number - 1])
        return "\n".join(lines)

    return edit


def field(number: int, column: str, value: str) -> Edit:
    """One field of a table changed."""

    def edit(text: str) -> str:
        lines = text.split("\n")
        fields = lines[number - 1].split(",")
        fields[lines[0].split(",").index(column)] = value
        lines[number - 1] = ",".join(fields)
        return "\n".join(lines)

    return edit


def without(column: str) -> Edit:
    """A column removed."""

    def edit(text: str) -> str:
        lines = [line.split(",") for line in text.strip().split("\n")]
        index = lines[0].index(column)
        return "\n".join(",".join(f for i, f in enumerate(r) if i != index) for r in lines)

    return edit


def column(name: str, value: str) -> Edit:
    """One more column, the same in every row."""

    def edit(text: str) -> str:
        head, *rows = text.strip().split("\n")
        return "\n".join([f"{head},{name}", *(f"{row},{value}" for row in rows)])

    return edit


def lines(count: int) -> Edit:
    """The first lines only."""
    return lambda text: "\n".join(text.split("\n")[:count])


def no_rows_with(words: str) -> Edit:
    """Rows with some words removed."""
    return lambda text: "\n".join(row for row in text.split("\n") if words not in row)


def times(factor: float, *columns: str) -> Edit:
    """Numbers of some columns multiplied."""

    def edit(text: str) -> str:
        head, *rows = [row.split(",") for row in text.strip().split("\n")]
        for column in map(head.index, columns):
            for row in rows:
                row[column] = f"{float(row[column]) * factor:.9f}"
        return "\n".join(",".join(row) for row in (head, *rows))

    return edit


def exchanged(one: str, other: str) -> Edit:
    """Two words for each other, everywhere."""
    return lambda text: text.replace(one, "\0").replace(other, one).replace("\0", other)
