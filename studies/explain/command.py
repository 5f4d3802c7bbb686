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
    from rich.markdown import Markdown

    from studies.command.deliver import console_for
    from studies.explain import topics

    if topic is not None:
        text = topics.topic(topic)
    else:
        listed = topics.table_of((("topic", "is about"), [*topics.titles().items()]))
        more = "Every effect and criterion is also a topic (posecal explain effects, criteria)."
        text = f"# Topics of posecal explain TOPIC\n\n{listed}\n\n{more}"
    console_for(None).print(Markdown(text), soft_wrap=False)


@click.command()
@click.argument("kind", metavar="KIND", type=click.Choice(KINDS))
@one_line_faults
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
