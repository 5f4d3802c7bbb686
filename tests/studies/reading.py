"""What a reader reads, sentence by sentence: README, ``--help`` and the pages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

ROOT = Path(__file__).parents[2]
_CELL_WORDS = 5  # fewer are a name, not a sentence
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`]+`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_MADE = re.compile(r"^<!-- .* -->$", re.MULTILINE)
_END = re.compile(r"(?<=[.?!])[\"')*]*\s+(?=[\"'(*]*[A-Z0-9\-]|symbol|posecal)")
_WORD = re.compile(r"[A-Za-z0-9][\w'.,/%-]*")


def length(sentence: str) -> int:
    """Words of a sentence.

    >>> length("Run symbol, then read 0.3 mm.")
    6
    """
    return len(_WORD.findall(sentence))


def sentences(markdown: str) -> Iterator[str]:
    r"""Sentences of a text in Markdown.

    >>> list(sentences("# Title\n\nRun `a b`. It takes 0.3 s.\n\n- one\n- two\n\n    code here"))
    ['Run symbol.', 'It takes 0.3 s.', 'one', 'two']
    """
    text = _MADE.sub("", _LINK.sub(r"\1", _CODE.sub("symbol", _FENCE.sub("", markdown))))
    for block in re.split(r"\n[ \t]*\n", text):
        lines = block.strip("\n")
        if not lines.strip() or lines.startswith(("    ", "#", "**Parameters**")):
            continue
        if lines.startswith("|"):
            cells = [cell.strip() for line in lines.splitlines()[2:] for cell in line.split("|")]
            entries = [cell for cell in cells if length(cell) >= _CELL_WORDS]
        else:
            entries = re.split(r"^(?:- |\d+\. )", lines, flags=re.MULTILINE)
        for entry in entries:
            running = " ".join(entry.replace("**", "").split())
            yield from (own for own in _END.split(running) if length(own))


def texts() -> Iterator[tuple[str, str]]:
    """What is read, by name: the README, what ``--help`` says, every page, effects and criteria."""
    from calib.effects import EFFECTS
    from doe.criteria import CRITERIA
    from studies.command.explain import PAGES, page, text_of

    yield "README", (ROOT / "README.md").read_text(encoding="utf-8")
    yield "--help", "\n\n".join(help_texts())
    yield "effects and criteria", "\n\n".join(map(text_of, (*EFFECTS, *CRITERIA)))
    yield from ((name, page(name)) for name in PAGES)


def as_table(cells: Iterable[str]) -> str:
    """Cells as a table of one column."""
    return "\n".join(["| text |", "|---|", *(f"| {cell} |" for cell in cells)])


def help_texts() -> Iterator[str]:
    """What the commands say of themselves and of their options, without the examples."""
    from studies.cli import COMMANDS, loaded, main

    yield main.help or ""
    for name in COMMANDS:
        command = loaded(name)
        yield re.sub(r"\n\s*\x08.*", "", command.help or "", flags=re.DOTALL)
        yield as_table(p.help for p in command.params if isinstance(p, click.Option) and p.help)
