"""A command or an option that is not there is refused in one line that names what to use."""

import pytest

from studies.cli import COMMANDS
from studies.research.command_line import heard
from studies.struck import INSTEAD, remedy


@pytest.mark.parametrize("name", INSTEAD)
def test_what_to_use_is_said(name: str, tmp_path) -> None:
    if name in COMMANDS:
        pytest.skip("still a command")
    call = name if not name.startswith("-") else f"changes {name}"
    said = heard(call, tmp_path)
    assert said.status == 2
    assert len(said.err.splitlines()) == 1
    assert INSTEAD[name] in said.err


def test_another_word_is_left_to_click() -> None:
    assert remedy("No such command 'nowhere'.") is None
