"""The command ``posecal``. Heavy imports stand inside the commands, so that help comes at once."""

from __future__ import annotations

import io
import os
import signal
import sys
from importlib import import_module
from typing import NoReturn

import click

from studies.struck import remedy

COMMANDS = {
    "demo": "Run all steps on an example robot; its files can be edited.",
    "init": "Write a first cell file for your own robot.",
    "design": "Choose the poses to measure, and prove how good they are.",
    "compare": "Predict and simulate the accuracy of a plan.",
    "program": "Write a plan as a robot program (KUKA, UR, ABB, FANUC).",
    "import": "Join measured points with the joints of their poses.",
    "enough": "Say whether the measured poses are enough.",
    "identify": "Identify the model's parameters from measured points.",
    "diagnose": "Find the causes of the remaining error.",
    "compensate": "Correct commands, so that the real arm reaches its targets.",
    "changes": "Say what moved between two results of one robot.",
    "report": "Write one page of results, to hand on.",
    "schema": "Print the JSON Schema of a result.",
    "explain": "Explain words, keys, columns and effects.",
}
"""Name -> what the help says of it, in the order of a day of measurement."""

GROUPS = {
    "Start": ("demo", "init"),
    "A day of measurement": ("design", "program", "import", "enough"),
    "A result": ("identify", "diagnose", "compare", "compensate", "changes", "report"),
}
"""Title -> commands, as the help lists them."""

_HOMES = {"import": ("import_", "import_"), "schema": ("explain", "schema")}
"""Name -> module in ``command``, and its function, where these are not called like the command."""


class _OnCall(click.Group):
    """Commands of which names and short help are known, and that are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        width = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), COMMANDS[name]) for name in names])

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, known, rest = super().resolve_command(ctx, args)
        return name, None if known is None else loaded(str(known.name)), rest


def loaded(name: str) -> click.Command:
    """A command itself."""
    module, function = _HOMES.get(name, (name, name))
    command: click.Command = getattr(import_module(f"studies.command.{module}"), function)
    return command


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(
    cls=_OnCall,
    context_settings=_SETTINGS,
    commands={name: click.Command(name, short_help=short) for name, short in COMMANDS.items()},
    epilog="posecal explain lists pages. posecal schema KIND prints the JSON Schema of a result.",
)
@click.version_option(package_name="posecal", prog_name="posecal")
def main() -> None:
    """Plan a robot calibration, identify the robot, and say how accurate the result is.

    New here? Run `posecal demo`. It writes a complete example that you can edit.
    """


def run() -> None:
    """Entry point: faults in the call end with one line and status 2, as those in files do."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal may know few characters
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that files are cleaned up
    for library in ("OPENBLAS", "MKL"):  # see calib.threads
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        status = main(sys.argv[1:] or ["--help"], prog_name="posecal", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
        sys.exit(status)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx is not None else "posecal"
        said = error.format_message().rstrip(".")
        _end(f"{command}: {said}; {remedy(said) or f'see {command} --help'}")
    except click.Abort:
        _end("posecal: interrupted; every file is as before or complete", 130)
    except MemoryError:
        _end("posecal: out of memory; take fewer readings, candidates, trials or targets")
    except OSError as error:
        if error.filename is not None:  # a file of ours: a fault of the installation
            raise
        with open(os.devnull, "w") as nowhere:  # so that Python's own last flush says nothing
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # closed by its reader, as by ``| head``
            sys.exit(141)  # as a shell reports it
        _end(f"posecal: standard output cannot be written ({error.strerror})")


def _end(line: str, status: int = 2) -> NoReturn:
    click.echo(line, err=True)
    sys.exit(status)
