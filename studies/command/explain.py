"""``posecal explain`` prints a page of ``docs``, an effect or a criterion; ``posecal schema`` too."""

from __future__ import annotations

import difflib
import inspect
import re
import sys
from importlib.resources import files

import click

from studies.command import options
from studies.kinds import KINDS

PAGES = (
    "words", "cell", "columns", "robots", "instruments", "camera", "effects", "design", "constraints",
    "uncertainty", "diagnosis", "motions", "commands", "python", "limits",
)  # fmt: skip
"""Names of the pages in the order in which one needs them."""


@click.command()
@click.argument("name", required=False)
@options.one_line_faults
def explain(name: str | None) -> None:
    """Print a page of the documentation, an effect or a criterion. Without NAME: list the pages.

    \b
    Example:
      posecal explain words
      posecal explain backlash
    """
    from studies.render import print_markdown

    print_markdown(text_of(name) if name else contents())


@click.command()
@click.argument("kind", metavar="KIND", type=click.Choice(KINDS))
@options.one_line_faults
def schema(kind: str) -> None:
    """Print the JSON Schema (draft 2020-12) of a result.

    KIND is a command that has --json. It may also be plan (diagnose --plan-only).

    \b
    Example:
      posecal schema enough > enough.schema.json
    """
    import json

    from studies.results.read import json_schema

    click.echo(json.dumps(json_schema(kind), indent=1))


def page(name: str) -> str:
    """The Markdown of a page."""
    return (files("studies") / "docs" / f"{name}.md").read_text(encoding="utf-8")


def contents() -> str:
    """The pages with their titles."""
    rows = (f"| {name} | {page(name).partition(chr(10))[0][2:]} |" for name in PAGES)
    listed = "\n".join(["| page | is about |", "|---|---|", *rows])
    more = "Every effect and every criterion has a page, too: see effects and design."
    return f"# Pages of posecal explain NAME\n\n{listed}\n\n{more}"


def text_of(name: str) -> str:
    """A page, an effect or a criterion as Markdown. Raises InputError for another name."""
    from calib.effects import catalogue as effects
    from calib.errors import InputError
    from doe.criteria import catalogue as criteria

    if name in PAGES:
        return page(name)
    kinds: dict[str, type] = {**effects(), **criteria()}
    if name not in kinds:
        close = difflib.get_close_matches(name, [*PAGES, *kinds], n=1)
        hint = f"did you mean {close[0]}?" if close else "posecal explain lists them"
        raise InputError("explain", "", f"no page {name!r}", hint)
    row = table_row(page("effects" if name in effects() else "design"), name)
    return "\n\n".join([f"# {name}", *paragraphs(kinds[name], [*kinds.values()]), row])


def table_row(text: str, name: str) -> str:
    """The first table row of a page that begins with a name, below its head."""
    found = re.search(rf"^(\|.*\n\|[-|]+\n)(?:\|.*\n)*?(\| {re.escape(name)} \|.*)", text, re.M)
    return "" if found is None else found[1] + found[2]


def paragraphs(kind: type, others: list[type]) -> list[str]:
    """What the docstrings say: of the module where it holds one kind alone, and of the class."""
    alone = sum(other.__module__ == kind.__module__ for other in others) == 1
    module = (inspect.getdoc(sys.modules[kind.__module__]) or "") if alone else ""
    texts = f"{module}\n\n{inspect.getdoc(kind) or ''}".split("\n\n")
    return [*dict.fromkeys(plain(own) for own in texts if own and not _FIELDS.match(own))]


_FIELDS = re.compile(r"[\w, ]+ : ")  # a paragraph that describes fields


def plain(text: str) -> str:
    """Running words, with references to code as names.

    >>> plain("Of :class:`calib.Cell`, as ``base``.")
    'Of `calib.Cell`, as `base`.'
    """
    return " ".join(re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text.replace("``", "`")).split())
