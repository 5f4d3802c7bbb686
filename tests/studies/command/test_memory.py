"""What is said where memory ends: what the command that was called can do with less of."""

from __future__ import annotations

import sys

import pytest

from studies import cli
from studies.cli import COMMANDS, run

REMEDIES = {
    "identify": "fewer readings",
    "diagnose": "fewer readings",
    "enough": "fewer readings",
    "design": "--candidates",
    "compare": "--monte-carlo",
    "fleet": "--workers",
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_names_what_it_can_do_with_less_of(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def exhausted(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(cli, "main", exhausted)
    monkeypatch.setattr(sys, "argv", ["posecal", command, "cell.toml"])
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("posecal: out of memory; ")
    assert said.count("\n") == 1
    assert REMEDIES.get(command, "") in said
    assert ("candidates" in said) == (command == "design")
