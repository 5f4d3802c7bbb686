"""What the README shows works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from calib.build import context_of
from calib.effects import EFFECTS
from calib.poses import poses_at
from studies.cli import main
from studies.demo import embedded_cell
from tests.studies.conftest import Demonstration

README = (Path(__file__).parent.parent.parent / "README.md").read_text()


@pytest.fixture
def beside_the_demo(
    demonstration: Demonstration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    demonstration.copied(tmp_path / "posecal-demo")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_python_example(beside_the_demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    block, _ = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    exec(compile(block, "README.md", "exec"), {})
    *parameters, design = capsys.readouterr().out.splitlines()
    assert len(parameters) == 42
    efficiency, _, shape = design.partition(" ")
    assert 0.9 < float(efficiency) <= 1.0
    assert shape == "(15, 6)"


def test_an_effect_of_ones_own() -> None:
    _, block = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    names: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), names)
    context = context_of(embedded_cell(), None)
    effect = names["WarmEncoder"].at(context, "A3")
    assert [p.id for p in effect.parameters] == ["warm_encoder:A3.slope"]
    warm = poses_at(np.zeros((2, 6)), temperature=np.array([20.0, 25.0]))
    np.testing.assert_allclose(effect.shares(warm), [[0.0], [5.0]])


def test_commands_and_their_output(beside_the_demo: Path) -> None:
    commands = re.findall(r"^ {4}posecal (.*)$", README, flags=re.M)
    assert commands
    output = "".join(CliRunner().invoke(main, command.split()).output for command in commands)
    spaced = " ".join(output.split())
    (shown,) = re.findall(r"```\n(kr270 .*?)```", README, flags=re.S)
    for line in shown.splitlines():
        assert " ".join(line.strip(" .").split()) in spaced, "the printed example is the real one"


def test_every_effect_is_described() -> None:
    table = README[README.index("| effect |") : README.index("Write `name` for everywhere")]
    first = "".join(line.split("|")[1] for line in table.strip().splitlines())
    assert set(re.findall(r"`(\w+)`", first)) == set(EFFECTS)
