"""Change a text as people and broken programs do: its numbers, words, lines, columns and nesting."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

_TOKEN = re.compile(r"[A-Za-z_][\w.]*|[-+]?[\d.]+(?:[eE][-+]?\d+)?|\s+|.", re.DOTALL)
NUMBERS = (
    "0", "-0", "1", "-1", "0.0", "1e-320", "1e-9", "1e9", "1e12", "1e15", "1e19", "1e154",
    "1e160", "1e308", "-1e308", "1e400", "nan", "-nan", "inf", "-inf", "infinity", "1_000",
    "0x10", "0b1", "1e", "1,5", "٣", "1٣", "½", "9223372036854775808", "true", "null", "None",
    "NaN", "Infinity", "5x3", ".5", "5.", "360", "181", "-181", "1e6", "3.5e4",
    "1000000000000000000000000000000000",
)  # fmt: skip
WORDS = (
    "", " ", "<!DOCTYPE r [<!ENTITY a 'b'>]>", "$\\frac$", "'", '"', '""', "'''", '"""', "\\",
    "\\u0000", "\\n", "\\ud800", "\\u001b[31m", "\x00", "\x1b[31m", "\x7f", "\x85", "\r",
    "\u2028", "\u202e", "\ufeff", "\U0001f916", "\udcff", "x" * 3000, "\t",
    "[bold]", "[/]", "[/bold]", "[link=x]", ":smile:", "../../x", "/dev/null", "/dev/zero", "..",
    "<b>", "&amp;", "&a;", "<![CDATA[", "<!--", "%s", "{x}", "{{x}}", "#", ";", "__proto__",
    "base", "tool", "pose", "marker", "__class__",
)  # fmt: skip
_DEEP = ("[", "{a=[", '{"a":', "a.", "[[", "<a>", "(")


def mutated(text: str, others: Sequence[str], rng: random.Random) -> str:
    """A neighbour of a text; ``others`` lend words and lines."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        text = rng.choice(_CHANGES)(text, rng.choice(others), rng)
    return text


Change = Callable[[str, str, random.Random], str]


def _tokens(text: str) -> list[str]:
    return _TOKEN.findall(text) or [""]


def _number(text: str, _: str, rng: random.Random) -> str:
    """Another number in place of one."""
    tokens = _tokens(text)
    if places := [i for i, token in enumerate(tokens) if any(c.isdigit() for c in token)]:
        tokens[rng.choice(places)] = rng.choice(NUMBERS)
    return "".join(tokens)


def _word(text: str, other: str, rng: random.Random) -> str:
    """Another word in place of a token, or beside it."""
    tokens = _tokens(text)
    place = rng.randrange(len(tokens))
    new = rng.choice((rng.choice(WORDS), rng.choice(_tokens(other)), rng.choice(NUMBERS)))
    tokens[place] = rng.choice((new, new + tokens[place], tokens[place] + new))
    return "".join(tokens)


def _parts(own: list[str], foreign: list[str], rng: random.Random) -> list[str]:
    """A run removed, doubled, repeated, or taken from elsewhere."""
    start, lent = rng.randrange(len(own)), rng.randrange(len(foreign))
    run = own[start : start + rng.choice((1, 1, 2, 4, 12))]
    new = rng.choice(([], run * 2, run * 40, foreign[lent : lent + 8]))
    return own[:start] + new + own[start + len(run) :]


def _part(text: str, other: str, rng: random.Random) -> str:
    return "".join(_parts(_tokens(text), _tokens(other), rng))


def _line(text: str, other: str, rng: random.Random) -> str:
    return "\n".join(_parts(text.split("\n"), other.split("\n"), rng))


def _column(text: str, _: str, rng: random.Random) -> str:
    """Every field of a column alike, or the column gone."""
    lines = [line.split(",") for line in text.split("\n")]
    place, gone = rng.randrange(max(map(len, lines))), rng.random() < 0.3
    new = [] if gone else [rng.choice((*NUMBERS, *WORDS))]
    for row in lines[1:] if not gone and rng.random() < 0.8 else lines:
        if place < len(row):
            row[place : place + 1] = new
    return "\n".join(",".join(row) for row in lines)


def _deep(text: str, _: str, rng: random.Random) -> str:
    """Nesting."""
    place = rng.randrange(len(text) + 1)
    return text[:place] + rng.choice(_DEEP) * rng.choice((3, 200, 3000)) + text[place:]


def _ends(text: str, _: str, rng: random.Random) -> str:
    """Cut short, other line ends, a mark of byte order."""
    cut = text[: rng.randrange(len(text) + 1)]
    return rng.choice((cut, text.replace("\n", "\r\n"), text.replace("\n", "\r"), "\ufeff" + text))


_CHANGES: tuple[Change, ...] = (_number, _number, _word, _word, _part, _line, _column, _deep, _ends)
