"""What a person meets before any work is done: help, and completion in the shell."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner

from studies.cli import COMMANDS, GROUPS, loaded, main

RUN = "from studies.cli import run; run()"
HEAVY = [
    "cvxpy",
    "distributed",
    "jinja2",
    "matplotlib",
    "mujoco",
    "numpy",
    "pydantic",
    "rich",
    "scipy",
]
ASKED = [["--help"], ["--version"], ["nonsense"], *([name, "--help"] for name in main.commands)]


def test_nothing_heavy_is_imported_for_help() -> None:
    """So that it comes at once; `python -m studies.research.speed` measures it.

    One process is asked all: what one word brings stays for those after it.
    """
    code = f"""
import contextlib, io, sys
from studies.cli import run
for words in {ASKED}:
    said = io.StringIO()
    sys.argv = ["posecal", *words]
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            run()
        except SystemExit:
            pass
    brought = {set(HEAVY)} & sys.modules.keys()
    if words in {ASKED[:3]}:
        brought |= {{name for name in sys.modules if name.endswith(".command")}}
    print(*words, bool(said.getvalue()), *brought)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [f"{' '.join(words)} True" for words in ASKED]


def test_help_lists_the_commands_in_three_groups() -> None:
    said = CliRunner().invoke(main, ["--help"]).output
    places = [said.index(f"\n{title}:\n") for title in GROUPS]
    assert places == sorted(places)
    for name in (name for names in GROUPS.values() for name in names):
        assert re.search(rf"^  {name} +{re.escape(COMMANDS[name])}$", said, flags=re.M)
    listed, _, end = said.rpartition("\n\n")
    assert {*COMMANDS} == {"explain", "schema"}.union(*GROUPS.values())
    for name in ("explain", "schema"):
        assert f"\n  {name} " not in listed
        assert f"posecal {name}" in end


@pytest.mark.parametrize("name", COMMANDS)
def test_every_name_of_the_help_is_a_command_with_an_example(name: str) -> None:
    command = loaded(name)
    assert command.name == name
    assert f"posecal {name}" in (command.help or "").partition("Example")[2]


def test_options_choices_and_files_are_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the command answers the script that a shell evaluates."""

    def completed(words: str) -> str:
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
        return BashComplete(main, {}, "posecal", "_POSECAL_COMPLETE").complete()

    assert completed("posecal design --cri") == "plain,--criterion"
    assert "plain,task-worst" in completed("posecal design --criterion ").split()
    for words in ("posecal identify ", "posecal identify --json "):
        assert completed(words).startswith("file,")
