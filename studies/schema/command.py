"""``posecal schema``: what the JSON of a result holds, for programs that read it."""

from __future__ import annotations

import click

from studies.command.options import one_line_faults
from studies.kinds import KINDS


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
