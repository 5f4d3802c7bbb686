"""The command ``posecal``. Heavy imports stand inside the commands, so that help comes at once."""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import NoReturn

import click

from studies.struck import remedy

COMMANDS = {
    "demo": (
        "command.demo:demo",
        "Run all steps on an example robot; its files can be edited.",
    ),
    "init": ("command.init:init", "Write a first cell file for your own robot."),
    "design": (
        "command.design:design",
        "Choose the poses to measure, and prove how good they are.",
    ),
    "compare": ("command.compare:compare", "Predict and simulate the accuracy of a plan."),
    "program": (
        "command.program:program",
        "Write a plan as a robot program (KUKA, UR, ABB, FANUC).",
    ),
    "import": (
        "command.import_:import_",
        "Join measured points with the joints of their poses.",
    ),
    "enough": ("command.enough:enough", "Say whether the measured poses are enough."),
    "identify": (
        "command.identify:identify",
        "Identify the model's parameters from measured points.",
    ),
    "diagnose": ("command.diagnose:diagnose", "Find the causes of the remaining error."),
    "compensate": (
        "command.compensate:compensate",
        "Correct commands, so that the real arm reaches its targets.",
    ),
    "changes": ("command.changes:changes", "Say what moved between two results of one robot."),
    "report": ("command.report:report", "Write one page of results, to hand on."),
    "schema": ("command.explain:schema", "Print the JSON Schema of a result."),
    "explain": ("command.explain:explain", "Explain words, keys, columns and effects."),
}
"""Name -> where the command is, and what the help says of it, in the order of a day of measurement."""

GROUPS = {
    "Start": ("demo", "init"),
    "A day of measurement": ("design", "program", "import", "enough"),
    "A result": ("identify", "diagnose", "compare", "compensate", "changes", "report"),
}
"""Title -> commands, as the help lists them."""


_TABLE = "give a table with fewer readings at each pose"
_LESS = {
    "design": "take fewer --candidates or --poses",
    "compare": "take fewer trials (--monte-carlo) or --workers",
    "compensate": "give fewer targets",
    **dict.fromkeys(("enough", "identify", "diagnose"), _TABLE),
}
"""Command -> what to do where it needs more memory than there is."""


class _OnCall(click.Group):
    """Commands of which names and short help are known, and that are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        width = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), COMMANDS[name][1]) for name in names])

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, known, rest = super().resolve_command(ctx, args)
        return name, None if known is None else loaded(str(known.name)), rest


def loaded(name: str) -> click.Command:
    """A command itself."""
    from importlib import import_module

    module, attribute = COMMANDS[name][0].split(":")
    found: click.Command = getattr(import_module(f"studies.{module}"), attribute)
    return found


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(
    cls=_OnCall,
    context_settings=_SETTINGS,
    commands={name: click.Command(name, short_help=short) for name, (_, short) in COMMANDS.items()},
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
        click.echo(f"{command}: {said}; {remedy(said) or f'see {command} --help'}", err=True)
        sys.exit(2)
    except click.Abort:
        click.echo("posecal: interrupted; every file is as before or complete", err=True)
        sys.exit(130)
    except MemoryError:
        click.echo(f"posecal: out of memory; {_less_memory(sys.argv[1:])}", err=True)
        sys.exit(2)
    except OSError as error:
        if error.filename is not None:  # a file of ours: a fault of the installation
            raise
        _end_of_output(error)


def _less_memory(arguments: list[str]) -> str:
    """What needs less memory, by the command that was called."""
    called = next((name for name in arguments if name in COMMANDS), "")
    return _LESS.get(called, "close other programs, or use a machine with more")


def _end_of_output(error: OSError) -> NoReturn:
    """Standard output was closed by its reader, as by ``| head``, or is full."""
    with open(os.devnull, "w") as nowhere:  # so that Python's own last flush says nothing
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        sys.exit(141)  # as a shell reports it
    click.echo(f"posecal: standard output cannot be written ({error.strerror})", err=True)
    sys.exit(2)
