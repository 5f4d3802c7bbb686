"""The command ``posecal``. Heavy imports stand inside the commands, so that help comes at once."""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import NoReturn

import click

from studies.changes.command import changes
from studies.compare.command import compare
from studies.compensate.command import compensate
from studies.demo.command import demo
from studies.design.command import design
from studies.diagnose.command import diagnose
from studies.enough.command import enough
from studies.explain.command import explain
from studies.fleet.command import fleet
from studies.identify.command import identify
from studies.imports.command import import_
from studies.init.command import init
from studies.iso9283.command import iso9283
from studies.next.command import next_
from studies.programs.command import program
from studies.report.command import report
from studies.schema.command import schema


class _InOrder(click.Group):
    """Commands in the order of a day of measurement."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(cls=_InOrder, context_settings=_SETTINGS)
@click.version_option(package_name="posecal", prog_name="posecal")
def main() -> None:
    """Plan robot calibration experiments, identify the robot, say how accurate the result is.

    Start with `posecal demo`, which writes a complete example to edit.
    """


COMMANDS = (
    demo,
    init,
    design,
    compare,
    program,
    import_,
    enough,
    next_,
    identify,
    diagnose,
    compensate,
    iso9283,
    fleet,
    changes,
    report,
    schema,
    explain,
)
for command in COMMANDS:
    main.add_command(command)


def run() -> None:
    """Entry point: faults in the call end with one line and status 2, as those in files do."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal may know few characters
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that files are cleaned up
    try:
        status = main(sys.argv[1:] or ["--help"], prog_name="posecal", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
        sys.exit(status)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx is not None else "posecal"
        click.echo(
            f"{command}: {error.format_message().rstrip('.')}; see {command} --help", err=True
        )
        sys.exit(2)
    except click.Abort:
        click.echo("posecal: interrupted; every file is as before or complete", err=True)
        sys.exit(130)
    except MemoryError:
        click.echo("posecal: out of memory; take fewer candidates, poses or trials", err=True)
        sys.exit(2)
    except OSError as error:
        if error.filename is not None:  # a file of ours: a fault of the installation
            raise
        _end_of_output(error)


def _end_of_output(error: OSError) -> NoReturn:
    """Standard output was closed by its reader, as by ``| head``, or is full."""
    with open(os.devnull, "w") as nowhere:  # so that Python's own last flush says nothing
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        sys.exit(141)  # as a shell reports it
    click.echo(f"posecal: standard output cannot be written ({error.strerror})", err=True)
    sys.exit(2)
