"""One document as the terminal shows it."""

from __future__ import annotations

import io
from dataclasses import dataclass

from matplotlib.figure import Figure as Drawing
from rich.console import Console

from studies.document import (
    MM,
    Column,
    Detail,
    Document,
    Figure,
    Section,
    Sentence,
    Table,
    pictures_of,
)
from studies.document.terminal import terminal
from studies.plots.style import Picture


@dataclass(frozen=True)
class Row:
    name: str
    error: float | None


COLUMNS: tuple[Column[Row], ...] = (
    Column("target", lambda row: row.name),
    Column("error\nthere", lambda row: row.error, MM, "mm"),
    Column("secret", lambda row: row.name.upper(), detail=True),
)


def drawn() -> Picture:
    return Picture(
        "one", "One line", "What is seen.", Drawing(), ("pose", "x [mm]"), (("p1", 1.0),)
    )


def document(rows: int = 3, most: int | None = None) -> Document:
    table = Table(COLUMNS, [Row(f"p{i}", i / 3 or None) for i in range(rows)], "Errors", most=most)
    parts = (
        Sentence("0.0100 mm in each coordinate", label="noise"),
        Sentence("and more of it"),
        table,
        Figure(drawn),
        Detail((Sentence("only for the page"),), "Folded"),
    )
    return Document(
        (Sentence("The <answer> & why.", "good"),),
        (Section("first", "First", parts), Section("second", "Second", (Sentence("Last."),))),
    )


def printed(told: Document, of: str = "") -> str:
    console = Console(width=120, soft_wrap=True, markup=False)
    with console.capture() as caught:
        for part in terminal(told, of):
            console.print(part)
    return caught.get()


def test_the_terminal_shows_the_short_form() -> None:
    assert [line.rstrip() for line in printed(document(), "cell").splitlines()] == [
        "cell: The <answer> & why.",
        "noise      0.0100 mm in each coordinate",
        "           and more of it",
        "",
        "         error",
        "         there",
        "target    [mm]",
        "p0           -",
        "p1      0.3333",
        "p2      0.6667",
        "",
        "Second",
        "Last.",
    ]


def test_a_long_table_is_cut_at_the_terminal() -> None:
    told = document(rows=20, most=4)
    said = printed(told)
    assert "p3" in said
    assert "p4" not in said
    assert "and 16 more (JSON)" in said


def test_long_sentences_are_wrapped_between_words_and_names_stay_whole() -> None:
    name = "joint-with-a-name:" + "x" * 120
    told = Document((Sentence(f"{'word ' * 40}{name} end"),), ())
    lines = printed(told).splitlines()
    assert name in [line.strip() for line in lines] or any(name in line for line in lines)
    assert all(len(line) <= 100 for line in lines if name not in line)


def test_a_list_without_blanks_breaks_after_a_comma_and_a_number_does_not() -> None:
    names = "friction_windup:" + ",".join(f"joint_{k}" for k in range(40))
    numbers = "at " + ",".join("1234" for _ in range(40))
    section = Section("a", "A", (Sentence(names, label="not asked"), Sentence(numbers)))
    console = Console(file=io.StringIO(), width=300, highlight=False)
    with console.capture() as capture:
        console.print(*terminal(Document((), (section,))), sep="\n")
    lines = capture.get().splitlines()
    ours = [line for line in lines if "joint_" in line]
    assert len(ours) > 3
    assert all(len(line) <= 100 and line.endswith(",") for line in ours[:-1])
    assert "".join(line.removeprefix("not asked").strip() for line in ours) == names
    assert any(numbers.removeprefix("at ") in line for line in lines), "no figure is torn apart"


def test_figures_are_found_within_details() -> None:
    told = Document((), (Section("x", "x", (Detail((Figure(drawn),)), Figure(drawn))),))
    assert [picture.name for picture in pictures_of(told)] == ["one", "one"]
