"""How easily the texts read: Flesch reading ease and grade of README, help and topics.

    python -m studies.research.benchmarks.reading_ease [--longest] [--json FILE]

Reading ease is 206.835 - 1.015 words/sentences - 84.6 syllables/words (Flesch 1948); 60 and more is
plain English. The grade, 0.39 words/sentences + 11.8 syllables/words - 15.59 (Kincaid 1975), is in
school years. Syllables are those of textstat, which takes them from the CMU dictionary.

Titles, blocks of code and lists of parameters are left out. A name in backquotes counts as one word of
two syllables, a number as one word. Paragraphs, entries of a list, and cells of a table with five words
or more count, each as one sentence or several.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import click

from studies.research.bench import Output, bench, table

ROOT = Path(__file__).parents[3]
LONG = 25  # words
_CELL_WORDS = 5  # fewer are a name, not a sentence
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`]+`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_MADE = re.compile(r"^\{[\w.]+\}$", re.MULTILINE)
_END = re.compile(r"(?<=[.?!])[\"')*]*\s+(?=[\"'(*]*[A-Z0-9\-]|symbol|posecal)")
_WORD = re.compile(r"[A-Za-z0-9][\w'.,/%-]*")


@dataclass(frozen=True)
class Ease:
    """Figures of one text."""

    name: str
    sentences: tuple[str, ...]
    words: int
    syllables: int

    @property
    def flesch(self) -> float:
        """Flesch reading ease: larger is easier."""
        return (
            206.835 - 1.015 * self.words / len(self.sentences) - 84.6 * self.syllables / self.words
        )

    @property
    def grade(self) -> float:
        """Flesch-Kincaid grade [school years]."""
        return 0.39 * self.words / len(self.sentences) + 11.8 * self.syllables / self.words - 15.59

    @property
    def longest(self) -> str:
        """The sentence of most words."""
        return max(self.sentences, key=length)

    @property
    def long_share(self) -> float:
        """Share of sentences of more than 25 words."""
        return sum(length(own) > LONG for own in self.sentences) / len(self.sentences)


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


def ease(name: str, markdown: str) -> Ease:
    """Figures of a text; there must be a sentence in it."""
    import textstat

    found = tuple(sentences(markdown))
    words = [word.rstrip(".,'%") for own in found for word in _WORD.findall(own)]
    syllables = sum(max(1, textstat.syllable_count(word)) for word in words)
    return Ease(name, found, len(words), syllables)


def texts() -> Iterator[tuple[str, str]]:
    """What is read, by name: the README, what ``--help`` says, every topic, effects and criteria."""
    from calib.effects import EFFECTS
    from doe.criteria import CRITERIA
    from studies.explain.cell_keys import meanings
    from studies.explain.topics import criterion_text, effect_text, written

    yield "README", (ROOT / "README.md").read_text(encoding="utf-8")
    yield "--help", "\n\n".join(help_texts())
    yield "cell keys", as_table(meanings().values())
    yield (
        "effects and criteria",
        "\n\n".join([*map(effect_text, EFFECTS), *map(criterion_text, CRITERIA)]),
    )
    yield from written().items()


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


@bench(click.option("--longest", is_flag=True, help="Also the longest sentence of each text."))
def main(longest: bool, seed: int) -> Output:
    """Say how easily README, help and topics read."""
    del seed
    found = [ease(name, text) for name, text in texts()]
    figures = {
        own.name: {
            "reading_ease": own.flesch,
            "grade": own.grade,
            "sentences": len(own.sentences),
            "longest_words": length(own.longest),
            "long_share": own.long_share,
        }
        for own in found
    }
    shown = table(
        {
            "text": own.name,
            "ease": f"{own.flesch:.0f}",
            "grade": f"{own.grade:.1f}",
            "sentences": len(own.sentences),
            "words": own.words,
            "longest [words]": length(own.longest),
            f"over {LONG} words": f"{own.long_share:.0%}",
        }
        for own in found
    )
    return [shown, *(f"{own.name}: {own.longest}" for own in found if longest)], figures


if __name__ == "__main__":
    main()
