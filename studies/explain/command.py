"""``posecal explain``: what a word, a key, a column, an effect or a figure means."""

from __future__ import annotations

import click

from studies.command.options import one_line_faults


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
    from studies.explain.text import document_of

    if topic is not None:
        show(terminal(topics.topic(topic)), None)
        return
    listed = "\n".join(f"| {name} | {title} |" for name, title in topics.titles().items())
    text = f"# Topics of posecal explain TOPIC\n\n| topic | is about |\n|---|---|\n{listed}\n"
    more = "Every effect and criterion is also a topic (posecal explain effects, criteria)."
    show((*terminal(document_of(text, lambda _: ((), []))), Text(f"\n{more}")), None)
