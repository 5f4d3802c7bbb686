"""All sentences of the templates, to be read aloud: ``python -m studies.research.sentences [KIND ..]``.

A value stands as "_". Conditions are left out, so that what is said in either case follows each other.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import click

FOLDER = Path(__file__).parents[1] / "templates"


def sentences(template: str) -> Iterator[str]:
    """Sentences of a template, without its tables.

    >>> list(sentences("**{{ r.cell }}: Done in {{ n }} s.** Go on.{% if x %} Or stop.{% endif %}"))
    ['_: Done in _ s.', 'Go on.', 'Or stop.']
    """
    text = re.sub(r"\{#.*?#\}", "", template, flags=re.DOTALL)
    text = re.sub(r"\{\{-?\s*\"([^\"]*)\"\s*-?\}\}", r"\1", text)
    text = re.sub(r"\{\{.*?\}\}", "_", text, flags=re.DOTALL)
    text = re.sub(r"\{%.*?%\}", "", text, flags=re.DOTALL).replace("**", "")
    for line in text.splitlines():
        if not line.strip().startswith("|"):
            yield from (
                own for own in re.split(r"(?<=[.!?])\s+", line.strip(" -#")) if own.strip("_ ")
            )


@click.command()
@click.argument("kinds", nargs=-1)
def main(kinds: tuple[str, ...]) -> None:
    """List the sentences of all templates, or of some kinds of result."""
    for path in sorted(FOLDER.glob("*.md.j2")):
        kind = path.name.partition(".")[0]
        if not kinds or kind in kinds:
            click.echo(f"\n{kind}")
            for own in sentences(path.read_text(encoding="utf-8")):
                click.echo(f"  {own}")


if __name__ == "__main__":
    main()
