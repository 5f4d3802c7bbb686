"""The command ``posecal``. Heavy imports stand inside the commands, so that help comes at once."""

from __future__ import annotations

import sys

import click

from studies.commands.compare import compare
from studies.commands.demo import demo
from studies.commands.design import design
from studies.commands.diagnose import diagnose
from studies.commands.identify import identify


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="posecal", prog_name="posecal")
def main() -> None:
    """Plan robot calibration experiments, identify the robot, say how accurate the result is.

    Start with `posecal demo`, which writes a complete example to edit.
    """


main.add_command(identify)
main.add_command(design)
main.add_command(compare)
main.add_command(diagnose)
main.add_command(demo)


def run() -> None:
    """Entry point: faults in the call end with one line and status 2, as those in files do."""
    try:
        sys.exit(main(prog_name="posecal", standalone_mode=False))
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx is not None else "posecal"
        click.echo(
            f"{command}: {error.format_message().rstrip('.')}; see {command} --help", err=True
        )
        sys.exit(2)
    except click.Abort:
        click.echo("posecal: interrupted, nothing was written", err=True)
        sys.exit(130)
