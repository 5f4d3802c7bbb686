"""The command ``posecal``. Heavy imports stand inside the commands, so that help comes at once."""

from __future__ import annotations

import click

from studies.commands.demo import demo
from studies.commands.identify import identify


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="posecal", prog_name="posecal")
def main() -> None:
    """Plan robot calibration experiments, identify the robot, say how accurate the result is.

    Start with `posecal demo`, which writes a complete example to edit.
    """


main.add_command(identify)
main.add_command(demo)
