"""``posecal explain`` and ``posecal schema``: what words and figures mean, and what JSON holds."""

from __future__ import annotations

import click

from studies.command.options import one_line_faults
from studies.kinds import KINDS


@click.command()
@click.argument("topic", required=False)
@one_line_faults
def explain(topic: str | None) -> None:
    """Explain a TOPIC, or list the topics.

    Every effect and every criterion is also a topic.

    \b
    Example:
      posecal explain words
      posecal explain backlash
    """
    from rich.text import Text

    from studies.command.deliver import show
    from studies.document.terminal import terminal
    from studies.explain import topics
    from studies.explain.topics import document_of

    if topic is not None:
        show(terminal(topics.topic(topic)), None)
        return
    listed = "\n".join(f"| {name} | {title} |" for name, title in topics.titles().items())
    text = f"# Topics of posecal explain TOPIC\n\n| topic | is about |\n|---|---|\n{listed}\n"
    more = "Every effect and criterion is also a topic (posecal explain effects, criteria)."
    show((*terminal(document_of(text, lambda _: ((), []))), Text(f"\n{more}")), None)


@click.command()
@click.argument("kind", metavar="KIND", type=click.Choice(KINDS))
@one_line_faults
def schema(kind: str) -> None:
    """Print the JSON Schema (draft 2020-12) of a result.

    KIND is a command that has --json. It may also be plan (diagnose --plan-only) or prior (fleet
    --prior).

    \b
    Example:
      posecal schema enough > enough.schema.json
    """
    import json

    from studies.results import json_schema

    click.echo(json.dumps(json_schema(kind), indent=1))
